"""The daemon's command line, with a counter of its objects: SIGUSR1 writes them to a file.

The first argument is that file, the second the one that moves its clocks (a suspend); the others
are the bridge's own.
"""

import gc
import signal
import sys
from pathlib import Path
from types import FrameType

from proofs.shifted_daemon import follow_shifts

from bridge.cli.main import main


def count_on_signal(report: Path) -> None:
    """From now on SIGUSR1 counts what the garbage collector knows and could not free."""

    def count(_number: int, _frame: FrameType | None) -> None:
        gc.collect()  # what is only waiting to be freed is no growth
        fresh = report.with_suffix(".fresh")
        fresh.write_text(str(len(gc.get_objects())))
        fresh.replace(report)  # whoever waits for the file finds it whole

    signal.signal(signal.SIGUSR1, count)


if __name__ == "__main__":
    count_on_signal(Path(sys.argv[1]))
    follow_shifts(Path(sys.argv[2]))
    sys.exit(main(sys.argv[3:]))
