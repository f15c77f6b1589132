"""`make proofs`: runs every proof in full, or those named, and prints the table."""

import argparse
import sys
from collections.abc import Sequence

from proofs import everything
from proofs.figures import NOT_HERE
from proofs.side_by_side import proved


def main(names: Sequence[str], jobs: int) -> int:
    """Prints a row a proof; 1 when a promise was not kept."""
    order = sorted(names or everything.PROOFS, key=lambda name: (name[0], int(name[1:])))
    broken = []
    print(f"{'id':<4}{'':<4}{'injected':<62} {'seen':<58} {'promised':<50} s", flush=True)
    for name, figure, took_s in proved(order, jobs):
        mark = "ok" if figure.kept else "NO"
        print(
            f"{name:<4}{mark:<4}{figure.injected:<62} {figure.seen:<58} {figure.promised:<50}"
            f" {took_s:.0f}",
            flush=True,
        )
        if not figure.kept:
            broken.append(name)
    if not names:
        for name, reason in NOT_HERE.items():
            print(f"{name:<4}{'--':<4}not proved here: {reason}")
    if broken:
        print(f"promises not kept: {', '.join(broken)}", file=sys.stderr)
    return 1 if broken else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make proofs", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="ID", help="such as A5; default: all")
    parser.add_argument("--jobs", type=int, default=3, help="how many at a time: most wait")
    return parser.parse_args()


if __name__ == "__main__":
    arguments = _arguments()
    sys.exit(main(arguments.names, arguments.jobs))
