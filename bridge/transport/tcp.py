"""Raw serial gateways on the network: plain bytes over TCP."""

import socket
import struct
from collections.abc import Callable
from contextlib import ExitStack

from bridge.errors import PortError
from bridge.transport.descriptor import DescriptorPort
from bridge.transport.port import Port

_CONNECT_S = 2.0
_GONE = (
    "the gateway closed the connection: is it on, does another program use it, "
    "or is it in Modbus TCP mode?"
)
# A request that waits in a stalled link must not reach the module later than a command may: 2 s
# after it was sent (docs/contract.md, promise 2) the kernel drops it with the connection.
_UNACKNOWLEDGED_MS = 2000
_KEEPALIVE_IDLE_S = 5
_KEEPALIVE_EVERY_S = 2
_KEEPALIVE_PROBES = 3
# For the same reason, a close drops the bytes that were not sent yet.
_DROP_AT_CLOSE = struct.pack("ii", 1, 0)


def open_tcp(host: str, port: int, release: Callable[[], None] = lambda: None) -> Port:
    """Connect to a gateway that passes plain bytes.

    `release` is called once the port is closed.

    Raises:
        PortError: There is no answer; the message says what to do.
    """
    name = f"tcp://{host}:{port}"
    try:
        connection = socket.create_connection((host, port), timeout=_CONNECT_S)
    except (OSError, UnicodeError) as error:  # UnicodeError: a host that is no name at all
        raise PortError(f"{name}: {error}: is the gateway on, and its address right?") from error
    connection.setblocking(False)
    give_up_early(connection)
    closing = ExitStack()
    closing.callback(release)
    closing.callback(connection.close)
    return DescriptorPort(name, connection.fileno(), closing.close, gone=_GONE)


def give_up_early(connection: socket.socket) -> None:
    """Set the socket to send at once, to notice a dead link, and to drop unsent bytes on close."""
    for level, option, value in (
        (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
        (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED_MS),
        (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _KEEPALIVE_IDLE_S),
        (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _KEEPALIVE_EVERY_S),
        (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _KEEPALIVE_PROBES),
        (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    ):
        connection.setsockopt(level, option, value)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _DROP_AT_CLOSE)
