"""`make fleet`: clusters of brokers under kills, what one broker carries, and its alerts."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from fleet.alerts import run_alerts
from fleet.carried import run_fleet
from fleet.clusters import BridgedMosquittos, Cluster, NatsCluster, RabbitCluster
from fleet.kills import kill_nodes
from fleet.table import kept, table

_CLUSTERS: dict[str, Callable[[Path, ExitStack], Cluster]] = {
    "nats": NatsCluster,
    "mosquitto": BridgedMosquittos,
    "rabbitmq": RabbitCluster,
}
_PARTS = ("prometheus", "bridges", *_CLUSTERS)


def _tell(text: str) -> None:
    print(text, flush=True)


def _clusters(name: str, directory: Path, arguments: argparse.Namespace) -> bool:
    killing = kill_nodes(_CLUSTERS[name], directory, arguments.count, arguments.seed, _tell)
    for line in table(name, killing):
        _tell(line)
    return kept(killing)


def _run(name: str, directory: Path, arguments: argparse.Namespace) -> bool:
    if name == "prometheus":
        return run_alerts(directory, _tell)
    if name == "bridges":
        for amount in arguments.bridges:
            run_fleet(directory, amount, arguments.queued, _tell)
        return True
    return _clusters(name, directory, arguments)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make fleet", description=__doc__)
    parser.add_argument("only", nargs="*", choices=[*_PARTS, []], help="default: all")
    parser.add_argument("--count", type=int, default=1000, help="kills of each cluster")
    parser.add_argument(
        "--bridges", type=int, nargs="+", default=[5, 20, 100], help="so many at one broker"
    )
    parser.add_argument(
        "--queued", type=int, default=1_000_000, help="max_queued_messages; its own default is 1000"
    )
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


def main(arguments: argparse.Namespace) -> int:
    """Run each part in a directory of its own; 1 when a promise of the bridge was not kept."""
    all_kept = True
    for name in arguments.only or _PARTS:
        with tempfile.TemporaryDirectory(prefix=f"fleet-{name}-") as directory:
            all_kept &= _run(name, Path(directory), arguments)
    return 0 if all_kept else 1


if __name__ == "__main__":
    sys.exit(main(_arguments()))
