"""Opens whatever a line's `port` names: a device, tcp://host:port or rfc2217://host:port.

A device is locked by opening it (flock, TIOCEXCL). An address on the network is locked on this
machine before it is connected to: a gateway gives two clients each other's replies, or drops the
one that was there.
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
    """Open the port that the configuration names.

    Args:
        url: The port.
        baud: Bits a second.
        lock: What `take_port_lock` returned; None: it is taken here. It ends with the port.

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
    """Lock the address of a gateway as it is written.

    Raises:
        PortBusyError: Another program on this machine has it.
        PortError: The address cannot be read; the message says how one is written.
    """
    return _take(url, *_address(url))


def is_gateway(url: str) -> bool:
    """Return whether a port is on the network, and not a device of this machine."""
    return "://" in url


def same_port(one: str, other: str) -> bool:
    """Return whether both name the same device, or the same address of a gateway."""
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
    """Return the addresses of a host, so that its name and its number are one lock."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return set()  # connecting will say what is wrong
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
