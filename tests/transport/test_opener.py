import os
import socket

import pytest
from support.rfc2217_server import Rfc2217Server

from bridge.errors import PortError
from bridge.transport.opener import open_port


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
