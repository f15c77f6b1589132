"""`make bench`: runs the cases, or those named; prints a table, writes JSON, tables and a chart."""

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from support.mosquitto import Mosquitto

from bench.cases import all_cases
from bench.chart import chart
from bench.measure import Result, measure
from bench.priority import go_first
from bench.report import HEAD, markdown, row

# By itself it drops what a listener is too slow for: the first burst of 256 stations.
_BROKER = ("log_type none", "max_queued_messages 0")


def main(arguments: list[str]) -> int:
    """Prints a row a case as it ends."""
    parser = argparse.ArgumentParser(prog="bench")
    parser.add_argument("cases", nargs="*", help="letters, or letter:protocol")
    parser.add_argument("--json", type=Path, default=Path("build/bench.json"))
    parser.add_argument("--tables", type=Path, default=Path("build/bench.md"))
    parser.add_argument("--chart", type=Path, default=Path("build/bench.svg"))
    options = parser.parse_args(arguments)
    chosen = [
        case
        for case in all_cases()
        if not options.cases or {case.letter, f"{case.letter}:{case.protocol}"} & set(options.cases)
    ]
    go_first()
    results: list[Result] = []
    with tempfile.TemporaryDirectory(prefix="bench-broker-") as directory:
        broker = Mosquitto(Path(directory), options=_BROKER)
        broker.start()
        print(HEAD, flush=True)
        try:
            for case in chosen:
                results.append(measure(case, broker.port))
                print(row(results[-1]), flush=True)
        finally:
            broker.stop()
    for path in (options.json, options.tables, options.chart):
        path.parent.mkdir(parents=True, exist_ok=True)
    options.tables.write_text(markdown(results))
    options.chart.write_text(chart(results))
    options.json.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
