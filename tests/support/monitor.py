"""`wisco2mqtt monitor`, as a process of its own beside a tapped line."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from support.tapped_line import TAP

PATIENCE_S = 20.0


class Monitor:
    """The running command, listening at `directory`/tap, with a transcript in record.txt."""

    def __init__(self, directory: Path, *arguments: str, baud: int = 19200) -> None:
        self.out = directory / "out"
        self.record = directory / "record.txt"
        with self.out.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "bridge", "monitor", str(directory / TAP),
                 "--baud", f"{baud}", "--record", str(self.record), *arguments],
                stdout=out, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
        # The record is made once the port is open.
        self.wait_until(self.record.exists)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Waits for it, as long as the command runs."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.01)  # a file tells nobody that it grew: it is looked at again

    def end(self, number: signal.Signals = signal.SIGINT) -> str:
        """Ends it well; returns what it said on stderr."""
        self.process.send_signal(number)
        _, told = self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0, told
        return str(told)

    def wait_for_entries(self, count: int) -> None:
        """Waits until it has recorded so many pieces."""
        self.wait_until(lambda: self.entries() == count)

    def entries(self) -> int:
        """Return the number of recorded pieces."""
        return sum(not line.startswith("#") for line in self.record.read_text().splitlines())
