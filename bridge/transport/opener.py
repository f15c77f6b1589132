"""Opens the `port` of a line: a device, tcp://host:port or rfc2217://host:port.

A device is locked when it is opened (flock, TIOCEXCL). The address of a gateway is locked on this
machine before the connection: with two clients a gateway gives each the replies of the other, or
drops the first one.
"""

import os
import socket
from contextlib import ExitStack
from urllib.parse import urlsplit

from bridge.errors import BridgeError, PortBusyError, PortError
from bridge.transport.lock import Lock, LockHeldError, take_lock
from bridge.transport.port import Port
from bridge.transport.serial_port import open_rfc2217, open_serial
from bridge.transport.tcp import open_tcp

_SCHEMES = frozenset({"tcp", "rfc2217"})


def open_port(url: str, baud: int, lock: Lock | None = None) -> Port:
    """Open the configured port.

    Args:
        url: The port.
        baud: Bits a second.
        lock: The result of `take_port_lock`; None: it is taken here. It is released with the port.

    Raises:
        PortBusyError: Another program on this machine has it.
        PortError: It cannot be opened; the message says what to do.
    """
    if not is_gateway(url):
        return open_serial(url, baud)
    locks = ExitStack()
    with ExitStack() as in_vain:
        in_vain.callback(locks.close)
        locks.enter_context(lock or take_port_lock(url))
        host, number = _address(url)
        for address in _resolved(host, number) - {host}:
            locks.enter_context(_take(url, address, number))
        if url.startswith("rfc2217"):
            port = open_rfc2217(url, baud, locks.close)
        else:
            port = open_tcp(host, number, locks.close)
        in_vain.pop_all()
    return port


def take_port_lock(url: str) -> Lock:
    """Lock the address of a gateway, as it is written.

    Raises:
        PortBusyError: Another program on this machine has it.
        PortError: The address is wrong; the message shows the right form.
    """
    return _take(url, *_address(url))


def is_gateway(url: str) -> bool:
    """Return whether a port is on the network, and not a device of this machine."""
    return "://" in url


def same_port(one: str, other: str) -> bool:
    """Return whether both are the same device, or the same address of a gateway."""
    if is_gateway(one) and is_gateway(other):
        return _address(one) == _address(other)
    return os.path.realpath(one) == os.path.realpath(other)


def _take(url: str, host: str, port: int) -> Lock:
    try:
        return take_lock(f"port {host}:{port}")
    except LockHeldError as error:
        raise PortBusyError(f"{url}: another program holds it: stop that one first") from error
    except BridgeError as error:
        raise PortError(f"{url}: {error}") from error


def _resolved(host: str, port: int) -> set[str]:
    """Return the addresses of a host, so that its name and its number share one lock."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return set()  # the connection will report what is wrong
    return {str(address[0]) for *_, address in found}


def _address(url: str) -> tuple[str, int]:
    scheme = url.partition("://")[0]
    if scheme not in _SCHEMES:
        raise PortError(f"{url}: a port is a path, tcp://host:port or rfc2217://host:port")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise PortError(f"{url}: {error}: write {scheme}://host:port") from error
    if not host or port is None:
        raise PortError(f"{url}: host or port is missing: write {scheme}://host:port")
    return host, port
