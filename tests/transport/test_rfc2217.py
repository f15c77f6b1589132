import socket
import time
from collections.abc import Iterator

import pytest
from support.open_files import open_files
from support.rfc2217_server import Rfc2217Server

from bridge.errors import PortError
from bridge.transport.port import Port
from bridge.transport.serial_port import open_rfc2217

# pyserial 3.5 names its thread in a manner that Python 3.10 calls old.
pytestmark = pytest.mark.filterwarnings(r"ignore:set(Daemon|Name)\(\):DeprecationWarning")

FAR_S = 30.0


@pytest.fixture
def server() -> Iterator[Rfc2217Server]:
    """A server whose serial port returns what it is sent."""
    running = Rfc2217Server()
    yield running
    running.close()


@pytest.fixture
def port(server: Rfc2217Server) -> Iterator[Port]:
    """An open port behind it."""
    opened = open_rfc2217(server.url, 57600)
    yield opened
    opened.close()


def _far() -> float:
    return time.monotonic() + FAR_S


def _write_for_ever(port: Port) -> None:
    """The first write after the server's end succeeds: the kernel does not know yet."""
    until = _far()
    while time.monotonic() < until:
        port.write(b"#01RDI\r", until)


def test_bytes_pass_as_they_are(server: Rfc2217Server, port: Port) -> None:
    """All 256 bytes pass both ways, FFh too, and the far port has our baud rate."""
    every = bytes(range(256))
    port.write(every, _far())
    assert port.read(256, _far()) == every
    assert server.device.baudrate == 57600
    assert port.name == server.url


def test_reading_ends_at_the_deadline(port: Port) -> None:
    """A mute line frees the thread at the deadline, with what came."""
    port.write(b"DI>", _far())
    assert port.read(3, _far()) == b"DI>"
    began = time.monotonic()
    assert port.read(8, began + 0.2) == b""
    assert 0.2 <= time.monotonic() - began < 5.0


def test_discard_returns_what_waits(port: Port) -> None:
    """Discarding empties the input and does not wait when there is nothing."""
    assert port.discard() == b""
    port.write(b"stale", _far())
    assert port.read(1, _far()) == b"s"
    taken, until = b"", _far()
    while len(taken) < 4 and time.monotonic() < until:
        taken += port.discard()
    assert taken == b"tale"


def test_server_hangs_up(server: Rfc2217Server, port: Port) -> None:
    """After the server hung up a read ends at once, a write fails soon, a close does not raise."""
    before = open_files()
    server.hang_up()
    began = time.monotonic()
    with pytest.raises(PortError, match="is the server up"):
        port.read(8, _far())
    assert time.monotonic() - began < 5.0
    with pytest.raises(PortError, match="is the server up"):
        _write_for_ever(port)
    port.close()
    port.close()
    with pytest.raises(PortError):
        port.discard()
    assert open_files() < before


def test_option_is_added_once(server: Rfc2217Server) -> None:
    """A URL with options of its own is taken as it is."""
    for option in ("?ign_set_control", "?timeout=2"):
        open_rfc2217(server.url + option, 9600).close()


def test_nobody_listens() -> None:
    """A refused connection asks for the server."""
    with socket.create_server(("127.0.0.1", 0)) as closed:
        number = closed.getsockname()[1]
    with pytest.raises(PortError, match="is the server up, and its port free"):
        open_rfc2217(f"rfc2217://127.0.0.1:{number}", 9600)
