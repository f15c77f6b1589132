"""`make soak MINUTES=60`: runs the soak and prints what it saw; 1 when a promise was broken."""

import argparse
import random
import sys
import tempfile
from pathlib import Path

from soak.report import broken_promises, describe
from soak.soak import run


def main() -> int:
    """Reads the arguments, soaks, reports."""
    parser = argparse.ArgumentParser(prog="soak")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="an empty folder for the logs")
    options = parser.parse_args()
    chance = random.Random(options.seed)  # noqa: S311  # no secret
    with tempfile.TemporaryDirectory(prefix="soak-") as directory:
        seen = run(options.minutes, chance, options.keep or Path(directory))
    print("\n".join(describe(seen)))
    broken = list(broken_promises(seen))
    print("\n".join(f"broken: {promise}" for promise in broken) or "all promises kept")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
