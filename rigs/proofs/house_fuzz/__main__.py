"""Runs houses, and prints what was done and what broke: `python -m proofs.house_fuzz --help`."""

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from proofs.house_fuzz.house import House
from proofs.house_fuzz.oracle import PROMISES
from proofs.house_fuzz.plan import WAYS
from proofs.house_fuzz.steps import Steps, with_calm

STEPS_A_HOUSE = 2500
CALM_S = 50.0
SHOWN = 5


def live_through(way: str, seed: int, steps: int, off: Sequence[str]) -> tuple[House, Counter[str]]:
    """Run one house to its end."""
    house = House(way, seed)
    house.oracle.off = set(off)
    counts: Counter[str] = Counter(houses=1)
    with house.in_place():
        house.start()
        house.settle(5.0)
        todo = Steps(house)
        for step in range(steps):
            before = len(house.oracle.broken)
            todo.one()
            counts["steps"] += 1
            if len(house.oracle.broken) > before:
                house.oracle.counts[f"first broken at step {step}"] += 1
                break
        if not house.oracle.broken:
            with_calm(house)
            house.settle(CALM_S)
            house.oracle.watch()
            house.oracle.judge_calm()
        house.stop()
    counts += house.oracle.counts
    counts["frames"] = sum(line.wire.total for line in house.oracle.lines.values())
    counts["virtual s"] = round(house.clockwork.now)
    return house, counts


def _most_mib() -> int:
    """Return the most memory so far; `ru_maxrss` would count that of the process before exec."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) // 1024


def rerun(way: str, seed: int) -> str:
    """Return the command that lives through one house again."""
    return (
        f"PYTHONHASHSEED=0 PYTHONPATH=.:tests:rigs python -m proofs.house_fuzz {way} --seed {seed}"
    )


def main() -> int:
    """Print a JSON document; 1 when a promise was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("way", choices=WAYS)
    parser.add_argument(
        "--seed", type=int, default=1, help="of the first house; the next ones follow"
    )
    parser.add_argument("--steps", type=int, default=STEPS_A_HOUSE, help="in all")
    parser.add_argument(
        "--off", nargs="*", default=[], choices=list(PROMISES), help="not looked at"
    )
    parser.add_argument("--go-on", action="store_true", help="after a house with a broken promise")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # one thread runs at a time: on one core it hands on fast
        os.sched_setaffinity(
            0, {max(os.sched_getaffinity(0), key=lambda n: (n + options.seed) % 2)}
        )
    counts: Counter[str] = Counter()
    broken: list[str] = []
    began, seed = time.monotonic(), options.seed
    while counts["steps"] < options.steps and (options.go_on or not broken):
        house_steps = min(STEPS_A_HOUSE, options.steps - counts["steps"])
        house, done = live_through(options.way, seed, house_steps, options.off)
        counts += done
        found = house.oracle.broken[:SHOWN]
        broken += [
            f"{rerun(options.way, seed)}\n    step {done['steps']}: {each}" for each in found
        ]
        broken += [f"{options.way} seed {seed}: {error}" for error in house.clockwork.errors]
        seed += 1
    counts["rss MiB"] = _most_mib()
    print(json.dumps({"counts": counts, "broken": broken, "s": round(time.monotonic() - began, 1)}))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
