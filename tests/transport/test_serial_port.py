import errno
import fcntl
import os
import struct
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from support.open_files import open_files

from bridge.errors import PortBusyError, PortError
from bridge.transport.port import Port
from bridge.transport.serial_port import open_serial

_TIOCGEXCL = 0x80045440
# Long enough that a test which runs into it has failed.
FAR_S = 30.0


class Pty:
    """A line: `path` is ours to open, `master` the modules' end."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        self.path = os.ttyname(self.slave)

    def hang_up(self) -> None:
        """Pulls the plug."""
        os.close(self.master)
        self.master = -1

    def close(self) -> None:
        """Gives both ends back."""
        if self.master >= 0:
            os.close(self.master)
        os.close(self.slave)

    def is_exclusive(self) -> bool:
        """Return whether the kernel would refuse a second program."""
        answer = fcntl.ioctl(self.slave, _TIOCGEXCL, struct.pack("i", 0))
        return answer != struct.pack("i", 0)

    def waiting(self) -> int:
        """Tells how many bytes wait in our input."""
        answer = fcntl.ioctl(self.slave, termios.FIONREAD, struct.pack("i", 0))
        return int.from_bytes(answer, "little")


@pytest.fixture
def pty() -> Iterator[Pty]:
    """A pseudo-terminal."""
    line = Pty()
    yield line
    line.close()


@pytest.fixture
def port(pty: Pty) -> Iterator[Port]:
    """An open port on it."""
    opened = open_serial(pty.path, 57600)
    yield opened
    opened.close()


def _far() -> float:
    return time.monotonic() + FAR_S


def test_bytes_pass_as_they_are(pty: Pty, port: Port) -> None:
    """All 256 bytes pass both ways: no end of line, no flow control, no echo is made of them."""
    every = bytes(range(256))
    port.write(every, _far())
    assert os.read(pty.master, 1000) == every
    os.write(pty.master, every)
    assert port.read(256, _far()) == every


def test_reading_ends_at_the_deadline(pty: Pty, port: Port) -> None:
    """With too few bytes, the deadline ends the wait and they are returned."""
    os.write(pty.master, b"DI>")
    began = time.monotonic()
    assert port.read(8, began + 0.1) == b"DI>"
    assert 0.1 <= time.monotonic() - began < 5.0


def test_reading_after_the_deadline_takes_what_is_there(pty: Pty, port: Port) -> None:
    """A thread that wakes late does not lose the bytes that came in time."""
    os.write(pty.master, b"DI>9EAB\r")
    assert port.read(8, time.monotonic() - 1.0) == b"DI>9EAB\r"


def test_line_settings(pty: Pty, port: Port) -> None:
    """The port runs at its baud rate with 8 data bits, no parity and 1 stop bit."""
    assert port.name == pty.path
    _, _, cflag, _, in_speed, out_speed, _ = termios.tcgetattr(pty.slave)
    assert in_speed == out_speed == termios.B57600
    assert cflag & (termios.CSIZE | termios.PARENB | termios.CSTOPB) == termios.CS8


def test_hang_up_while_reading(pty: Pty, port: Port) -> None:
    """Pulling the adapter ends a read at once, long before its deadline."""
    errors: list[Exception] = []

    def read() -> None:
        try:
            port.read(8, _far())
        except PortError as error:
            errors.append(error)

    os.write(pty.master, b"DI>")
    reader = threading.Thread(target=read)
    began = time.monotonic()
    reader.start()
    while pty.waiting() and time.monotonic() - began < FAR_S:
        time.sleep(0.001)
    pty.hang_up()
    reader.join(FAR_S)
    assert time.monotonic() - began < 5
    assert len(errors) == 1
    assert "is the adapter still plugged in?" in str(errors[0])


def test_every_call_after_a_hang_up(pty: Pty, port: Port) -> None:
    """After an unplug every call raises PortError, and a close does not raise."""
    pty.hang_up()
    with pytest.raises(PortError, match="still plugged in"):
        port.read(1, _far())
    with pytest.raises(PortError, match="still plugged in"):
        port.write(b"#01RDI\r", _far())
    with pytest.raises(PortError, match="still plugged in"):
        port.discard()
    port.close()
    port.close()


def test_line_that_takes_no_bytes(port: Port) -> None:
    """A write that cannot go on ends at its deadline."""
    began = time.monotonic()
    with pytest.raises(PortError, match="takes no bytes"):
        port.write(b"x" * 1_000_000, began + 0.1)
    assert time.monotonic() - began < 5.0


def test_second_opener_is_refused(pty: Pty, port: Port) -> None:
    """A port that is in use is not opened again, and the message says why."""
    assert pty.is_exclusive()
    with pytest.raises(PortBusyError, match="another program holds it"):
        open_serial(pty.path, 9600)
    port.close()
    assert not pty.is_exclusive()
    open_serial(pty.path, 9600).close()


def test_missing_device(tmp_path: Path) -> None:
    """A path that is not there asks for the adapter."""
    with pytest.raises(PortError, match=r"ttyUSB0: no such device: is the adapter plugged in\?"):
        open_serial(str(tmp_path / "ttyUSB0"), 9600)


def test_something_else_than_a_serial_port(tmp_path: Path) -> None:
    """A file is not taken for a device."""
    path = tmp_path / "file"
    path.touch()
    with pytest.raises(PortError, match="not usable as a serial port"):
        open_serial(str(path), 9600)


@pytest.mark.parametrize(
    ("code", "advice"),
    [
        (errno.EACCES, "add the user to the group dialout"),
        (errno.EPERM, "DeviceAllow= of the systemd unit"),
        (errno.EBUSY, "another program holds it"),
        (errno.ENXIO, "is the adapter plugged in"),
    ],
)
def test_advice_for_what_the_system_says(
    monkeypatch: pytest.MonkeyPatch, code: int, advice: str
) -> None:
    """Refusals that a test run by root does not meet come with their advice too."""

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(code, os.strerror(code))

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(PortError, match=advice):
        open_serial("/dev/ttyUSB0", 9600)


def test_opening_and_closing_leaks_nothing(pty: Pty) -> None:
    """A hundred reopenings, successful or not, leave the descriptor count flat."""
    before = open_files()
    for _ in range(100):
        port = open_serial(pty.path, 9600)
        with pytest.raises(PortError):
            open_serial(pty.path, 9600)
        port.close()
        port.close()
    assert open_files() == before


def test_closed_port_never_reaches_a_stranger(pty: Pty, port: Port) -> None:
    """After closing, bytes do not go to whatever got the same descriptor number."""
    port.close()
    other = open_serial(pty.path, 9600)
    with pytest.raises(PortError):
        port.write(b"stray", _far())
    other.write(b"ours", _far())
    assert os.read(pty.master, 100) == b"ours"
    other.close()
