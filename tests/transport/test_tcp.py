import contextlib
import socket
import struct
import time
from collections.abc import Iterator

import pytest
from support.open_files import open_files

from bridge.errors import PortError
from bridge.transport.port import Port
from bridge.transport.tcp import give_up_early, open_tcp

HOST = "127.0.0.1"
FAR_S = 30.0


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """A gateway's listening socket."""
    with socket.create_server((HOST, 0)) as server:
        yield server


@pytest.fixture
def ends(listener: socket.socket) -> Iterator[tuple[Port, socket.socket]]:
    """An open port and the gateway's side of it."""
    port = open_tcp(HOST, listener.getsockname()[1])
    gateway, _ = listener.accept()
    with gateway:
        yield port, gateway
    port.close()


def _far() -> float:
    return time.monotonic() + FAR_S


def test_bytes_pass_both_ways(ends: tuple[Port, socket.socket]) -> None:
    """Bytes go to the gateway and come from it unchanged."""
    port, gateway = ends
    every = bytes(range(256))
    port.write(every, _far())
    assert gateway.recv(1000) == every
    gateway.sendall(every)
    assert port.read(256, _far()) == every


def test_name_is_the_configured_one(
    ends: tuple[Port, socket.socket], listener: socket.socket
) -> None:
    """Messages name the port as the configuration does."""
    assert ends[0].name == f"tcp://{HOST}:{listener.getsockname()[1]}"


def test_gateway_closes(ends: tuple[Port, socket.socket]) -> None:
    """The gateway's end of the connection is an error at once, however far the deadline."""
    port, gateway = ends
    gateway.shutdown(socket.SHUT_RDWR)
    began = time.monotonic()
    with pytest.raises(PortError, match="the gateway closed the connection"):
        port.read(8, _far())
    assert time.monotonic() - began < 5.0


def test_gateway_resets(ends: tuple[Port, socket.socket]) -> None:
    """A reset is an error that names it."""
    port, gateway = ends
    gateway.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    gateway.close()
    with pytest.raises(PortError, match="reset"):
        port.read(8, _far())


def test_nobody_listens(listener: socket.socket) -> None:
    """A refused connection asks for the gateway."""
    number = listener.getsockname()[1]
    listener.close()
    with pytest.raises(PortError, match="refused: is the gateway on, and its address right"):
        open_tcp(HOST, number)


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A connection that is neither taken nor refused is given up after a while."""
    monkeypatch.setattr("bridge.transport.tcp._CONNECT_S", 0.2)
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server((HOST, 0), backlog=0))
        for _ in range(4):  # fills the queue: the kernel drops what comes after
            client = stack.enter_context(socket.socket())
            client.setblocking(False)
            client.connect_ex(server.getsockname())
        began = time.monotonic()
        with pytest.raises(PortError, match="timed out"):
            open_tcp(HOST, server.getsockname()[1])
        assert time.monotonic() - began < 5.0


def test_host_that_is_no_name() -> None:
    """A host that cannot be a name is an error like any other."""
    with pytest.raises(PortError, match="is the gateway on"):
        open_tcp("x" * 64, 4196)


def test_dead_links_are_noticed_and_forgotten() -> None:
    """No delay, a link that is probed, 2 s for what was sent, and nothing sent after closing."""
    with socket.socket() as connection:
        give_up_early(connection)
        for option, value in (
            (socket.TCP_NODELAY, 1),
            (socket.TCP_USER_TIMEOUT, 2000),
            (socket.TCP_KEEPIDLE, 5),
        ):
            assert connection.getsockopt(socket.IPPROTO_TCP, option) == value
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        linger = connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
        assert struct.unpack("ii", linger) == (1, 0)


def test_what_did_not_leave_is_dropped_at_close(ends: tuple[Port, socket.socket]) -> None:
    """Bytes that a stalled gateway has not taken never reach it after the port was closed."""
    port, gateway = ends
    with pytest.raises(PortError):
        port.write(bytes(32_000_000), time.monotonic() + 0.1)
    port.close()
    taken = 0
    with contextlib.suppress(ConnectionResetError):
        while data := gateway.recv(1_000_000):
            taken += len(data)
        pytest.fail(f"the connection ended in order after {taken} bytes")


def test_opening_and_closing_leaks_nothing(listener: socket.socket) -> None:
    """A hundred connections leave the descriptor count flat."""
    before = open_files()
    for _ in range(100):
        port = open_tcp(HOST, listener.getsockname()[1])
        gateway, _ = listener.accept()
        gateway.close()
        port.close()
        port.close()
    assert open_files() == before
