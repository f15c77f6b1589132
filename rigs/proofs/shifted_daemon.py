"""The daemon's command line under clocks that a proof moves: as a suspend does, or a time server.

The first argument is a file of two numbers, in seconds: what is added to the clock that counts a
suspend, and to the clock on the wall. Each look at a clock reads it, so the file can be changed
while the process is stopped, and no thread sees the old value afterwards.
"""

import mmap
import struct
import sys
import time
from datetime import datetime, timedelta
from pathlib import Path
from unittest.mock import patch

from bridge.cli.main import main
from bridge.daemon import app, wiring

SHIFTS = struct.Struct("dd")


def write_shifts(path: Path, boot_s: float, wall_s: float) -> None:
    """Move the clocks of the daemon that looks at this file."""
    with path.open("r+b" if path.exists() else "wb") as file:
        file.write(SHIFTS.pack(boot_s, wall_s))


def follow_shifts(path: Path) -> None:
    """Let this process live by clocks that the file moves, from now on."""
    with path.open("rb") as shared:
        shifts = mmap.mmap(shared.fileno(), SHIFTS.size, access=mmap.ACCESS_READ)
    real = time.clock_gettime

    def shifted(clock: int) -> float:
        """Return what a clock shows: the one that counts a suspend is moved."""
        moved = SHIFTS.unpack(shifts[:])[0] if clock == time.CLOCK_BOOTTIME else 0.0
        return real(clock) + moved

    time.clock_gettime = shifted

    def shifted_wall() -> datetime:
        """Return what the clock on the wall shows."""
        return wiring.wall_clock() + timedelta(seconds=SHIFTS.unpack(shifts[:])[1])

    patch.object(app, "wall_clock", shifted_wall).start()


if __name__ == "__main__":
    follow_shifts(Path(sys.argv[1]))
    sys.exit(main(sys.argv[2:]))
