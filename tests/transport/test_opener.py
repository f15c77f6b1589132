import os
import socket

import pytest
from support.rfc2217_server import Rfc2217Server

from bridge.errors import PortBusyError, PortError
from bridge.transport.opener import open_port, same_port, take_port_lock


def test_path_is_a_serial_device() -> None:
    """A port without a scheme is a device on this machine."""
    master, slave = os.openpty()
    try:
        port = open_port(os.ttyname(slave), 9600)
        assert port.name == os.ttyname(slave)
        port.close()
    finally:
        os.close(master)
        os.close(slave)


def test_tcp_is_a_raw_gateway() -> None:
    """tcp://host:port connects there, to names and to IPv6 addresses."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        open_port(f"tcp://localhost:{listener.getsockname()[1]}", 9600).close()
    with pytest.raises(PortError, match="refused"):
        open_port("tcp://[::ffff:127.0.0.1]:1", 9600)


@pytest.mark.filterwarnings(r"ignore:set(Daemon|Name)\(\):DeprecationWarning")
def test_rfc2217_is_a_serial_server() -> None:
    """rfc2217://host:port opens the port behind that server."""
    server = Rfc2217Server()
    try:
        open_port(server.url, 9600).close()
    finally:
        server.close()


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("tcp://gateway", "host or port is missing"),
        ("tcp://:4196", "host or port is missing"),
        ("tcp://gateway:many", "write tcp://host:port"),
        ("tcp://gateway:70000", "write tcp://host:port"),
        ("udp://gateway:4196", "a port is a path"),
    ],
)
def test_port_that_means_nothing(url: str, what: str) -> None:
    """A port that cannot be read says how one is written."""
    with pytest.raises(PortError, match=what):
        open_port(url, 9600)


@pytest.mark.parametrize(
    "other", ["tcp://127.0.0.1:{}", "tcp://LOCALHOST:{}", "rfc2217://localhost:{}"]
)
def test_a_gateway_is_opened_once_on_this_machine(other: str) -> None:
    """A gateway is opened once on this machine, whichever way its address is written."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        number = listener.getsockname()[1]
        first = open_port(f"tcp://localhost:{number}", 9600)
        listener.accept()[0].close()
        with pytest.raises(PortBusyError, match="another program holds it: stop that one first"):
            open_port(other.format(number), 9600)
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):
            listener.accept()
        first.close()
        open_port(f"tcp://127.0.0.1:{number}", 9600).close()


def test_a_gateway_that_is_absent_is_not_locked() -> None:
    """A gateway that could not be opened is not locked."""
    with pytest.raises(PortError, match="refused"):
        open_port("tcp://127.0.0.1:1", 9600)
    lock = take_port_lock("tcp://127.0.0.1:1")
    with pytest.raises(PortError, match="refused"):
        open_port("tcp://127.0.0.1:1", 9600, lock)
    take_port_lock("tcp://127.0.0.1:1").release()


def test_ports_that_are_the_same() -> None:
    """Gateways by their address, devices by where a link leads."""
    assert same_port("tcp://GATEWAY:23", "rfc2217://gateway:23")
    assert not same_port("tcp://gateway:23", "tcp://gateway:24")
    assert not same_port("tcp://gateway:23", "/dev/null")
    assert same_port("/dev/stdin", "/proc/self/fd/0")
