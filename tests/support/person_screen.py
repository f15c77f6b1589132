"""A program at a terminal, and what a person sees there: a pty, read by pyte."""

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

import pyte

ROWS, COLUMNS = 30, 100
PATIENCE_S = 30.0  # generous: the machine may be busy


class PersonScreen:
    """Runs a program at a terminal of its own; `stderr` of the program is the terminal too."""

    def __init__(self, command: Sequence[str], cwd: Path | None = None, **environment: str) -> None:
        self._command = command
        self._cwd = cwd
        self._environment = {**os.environ, "TERM": "xterm-256color", **environment}
        self._screen = pyte.Screen(COLUMNS, ROWS)
        self.received = b""  # all that it wrote, as it came
        self._stream = pyte.ByteStream(self._screen)

    def __enter__(self) -> Self:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self.process = subprocess.Popen(
            self._command,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=self._environment,
            cwd=self._cwd,
            start_new_session=True,
        )
        os.close(theirs)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(ProcessLookupError):  # what the program started has its group
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.hang_up()

    def hang_up(self) -> None:
        """Close the terminal, as a lost connection does."""
        if self._ours >= 0:
            os.close(self._ours)
            self._ours = -1

    def type(self, keys: str) -> None:
        """Presses keys."""
        os.write(self._ours, keys.encode())

    @property
    def text(self) -> str:
        """Return the text on the screen."""
        return "\n".join(row.rstrip() for row in self._screen.display)

    def wait_for(self, seen: str | Callable[[str], bool]) -> str:
        """Looks until a text stands there, or what is seen is right; returns the screen."""
        until = time.monotonic() + PATIENCE_S
        while not (seen in self.text if isinstance(seen, str) else seen(self.text)):
            assert time.monotonic() < until, f"this is what is seen:\n{self.text}"
            self._look(0.1)
        return self.text

    def wait_for_end(self) -> int:
        """Returns the exit status; what is printed last is still read."""
        until = time.monotonic() + PATIENCE_S
        while self.process.poll() is None:
            assert time.monotonic() < until, f"it goes on, and this is seen:\n{self.text}"
            self._look(0.1)
        while self._look(0):
            pass
        return self.process.returncode

    def _look(self, wait_s: float) -> bool:
        ready, _, _ = select.select([self._ours], [], [], wait_s)
        if not ready:
            return False
        try:
            data = os.read(self._ours, 65536)
        except OSError:  # Linux: the last one at the other end has left
            time.sleep(wait_s)
            return False
        self.received += data
        self._stream.feed(data)
        return True
