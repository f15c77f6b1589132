"""A simulated line behind a pseudo-terminal, at a path that stays the same over hang-ups."""

import os
import shutil
import tempfile
import termios
import tty
from contextlib import suppress
from pathlib import Path

from bridge.simulator.endpoint import READ_AT_MOST, write_patiently

BAUD_CONSTANTS = {
    4800: termios.B4800,
    9600: termios.B9600,
    19200: termios.B19200,
    57600: termios.B57600,
}
OTHER_BAUD = 0
INPUT_SPEED, OUTPUT_SPEED = 4, 5  # indices in the result of tcgetattr


class PtyEndpoint:
    """A pty behind a symbolic link.

    After a hang-up the link points to a new pty, as in /dev/serial/by-id. Without a path the link
    is in its own private directory.
    """

    def __init__(self, path: Path | None = None, *, baud: int) -> None:
        self._path = path
        self._baud = baud
        self._directory: str | None = None
        self._master: int | None = None
        self._slave: int | None = None

    @property
    def port(self) -> str:
        """Return the link."""
        return str(self._path)

    def open(self) -> None:
        """Make a pty and point the link at it."""
        self._master, self._slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(self._slave)
        self._set_speed(self._slave)
        self._link(os.ttyname(self._slave))

    def _set_speed(self, slave: int) -> None:
        """Set the baud rate of the line, for programs that open the port without setting one."""
        attributes = termios.tcgetattr(slave)
        attributes[INPUT_SPEED] = attributes[OUTPUT_SPEED] = BAUD_CONSTANTS[self._baud]
        termios.tcsetattr(slave, termios.TCSANOW, attributes)

    def _link(self, target: str) -> None:
        if self._path is None:
            self._directory = tempfile.mkdtemp(prefix="wisco-line-")
            self._path = Path(self._directory) / "port"
        if self._path.exists() and not self._path.is_symlink():
            raise FileExistsError(f"{self._path} is there already, and no link of a simulation")
        fresh = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        fresh.symlink_to(target)
        fresh.replace(self._path)

    def filenos(self) -> list[int]:
        """Return the descriptor of the pty."""
        return [] if self._master is None else [self._master]

    def read(self, fileno: int) -> bytes:
        """Return what the master of the line wrote into the pty."""
        try:
            return os.read(fileno, READ_AT_MOST)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Hand bytes to the program that has the port open."""
        if self._master is not None:
            write_patiently(self._master, data)

    def offer(self, data: bytes) -> None:
        """Hand over bytes if there is room: it may be that no program listens."""
        if self._master is not None:
            with suppress(BlockingIOError):
                os.write(self._master, data)

    def baud(self) -> int | None:
        """Return the baud rate that the program has set; 0: a rate that modules do not have."""
        if self._slave is None:
            return None
        speed = termios.tcgetattr(self._slave)[OUTPUT_SPEED]
        known = {constant: baud for baud, constant in BAUD_CONSTANTS.items()}
        return known.get(speed, OTHER_BAUD)

    def hang_up(self) -> None:
        """Remove the link and close both sides: a program that has the port open sees a hang-up."""
        if self._path is not None and self._path.is_symlink():
            self._path.unlink()
        for descriptor in (self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._master = self._slave = None

    def close(self) -> None:
        """Close the endpoint for good."""
        self.hang_up()
        if self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)
            self._directory = None
