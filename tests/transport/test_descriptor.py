import os
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from bridge.errors import PortError
from bridge.transport.descriptor import DescriptorPort

FAR_S = 30.0


@pytest.fixture
def ends() -> Iterator[tuple[DescriptorPort, socket.socket]]:
    """A port and its other side."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    port = DescriptorPort("pair", ours.fileno(), ours.close, gone="gone away")
    yield port, theirs
    port.close()
    theirs.close()


def _far() -> float:
    return time.monotonic() + FAR_S


def test_more_than_one_gulp(ends: tuple[DescriptorPort, socket.socket]) -> None:
    """Data that the descriptor takes and gives in parts passes completely."""
    port, theirs = ends
    much = os.urandom(2_000_000)
    writer = threading.Thread(target=port.write, args=(much, _far()))
    writer.start()
    with theirs.makefile("rb") as stream:
        assert stream.read(len(much)) == much
    writer.join()
    writer = threading.Thread(target=theirs.sendall, args=(much,))
    writer.start()
    assert port.read(len(much), _far()) == much
    writer.join()


def test_flood_does_not_hold_discard(ends: tuple[DescriptorPort, socket.socket]) -> None:
    """Discarding stops after a bounded amount, even when more keeps coming."""
    port, theirs = ends
    theirs.setblocking(False)
    flood = bytes(1_000_000)
    sent = theirs.send(flood)
    assert sent > 100_000
    assert 0 < len(port.discard()) < sent


def test_bytes_before_the_end_are_read(ends: tuple[DescriptorPort, socket.socket]) -> None:
    """Bytes from before a hang-up are read first; then PortError is raised."""
    port, theirs = ends
    theirs.sendall(b"DI>9EAB\r")
    theirs.close()
    assert port.read(8, _far()) == b"DI>9EAB\r"
    with pytest.raises(PortError, match="pair: gone away"):
        port.read(1, _far())


def test_writing_to_nobody(ends: tuple[DescriptorPort, socket.socket]) -> None:
    """A write after the other side hung up is an error with the system's word for it."""
    port, theirs = ends
    theirs.close()
    with pytest.raises(PortError, match=r"pair: gone away \(Broken pipe\)"):
        port.write(b"#01RDI\r", _far())


def test_descriptor_closed_by_somebody(ends: tuple[DescriptorPort, socket.socket]) -> None:
    """A descriptor that vanished under the port is an error, not a wait."""
    port, _ = ends
    port.close()
    with pytest.raises(PortError, match="gone away"):
        port.read(1, _far())


def test_readiness_is_only_a_hint(
    ends: tuple[DescriptorPort, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ready descriptor without data makes the port wait again."""
    port, theirs = ends
    real_read, real_write = os.read, os.write
    hints = [1, 1]

    def read(descriptor: int, count: int) -> bytes:
        if hints:
            hints.pop()
            raise BlockingIOError
        return real_read(descriptor, count)

    def write(descriptor: int, data: bytes) -> int:
        if hints:
            hints.pop()
            raise BlockingIOError
        return real_write(descriptor, data)

    theirs.sendall(b"DI>9EAB\r")
    with monkeypatch.context() as patch:
        patch.setattr(os, "read", read)
        assert port.read(8, _far()) == b"DI>9EAB\r"
    hints[:] = [1, 1]
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", write)
        port.write(b"#01RDI\r", _far())
    assert theirs.recv(100) == b"#01RDI\r"
    assert not hints


def test_what_came_too_early_waits_for_the_next_read(
    ends: tuple[DescriptorPort, socket.socket],
) -> None:
    """A read takes what was asked for; the rest is given by the next one, or discarded."""
    port, theirs = ends
    theirs.sendall(b"DI>9EAB\rDO>")
    assert port.read(6, _far()) == b"DI>9EA"
    assert port.read(2, _far()) == b"B\r"
    theirs.sendall(b"D2")
    assert port.discard() == b"DO>D2"
    assert port.read(1, time.monotonic()) == b""
