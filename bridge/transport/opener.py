"""Opens whatever a line's `port` names: a device, tcp://host:port or rfc2217://host:port."""

from urllib.parse import urlsplit

from bridge.errors import PortError
from bridge.transport.port import Port
from bridge.transport.serial_port import open_rfc2217, open_serial
from bridge.transport.tcp import open_tcp


def open_port(url: str, baud: int) -> Port:
    """Opens the port that the configuration names.

    Raises:
        PortError: It cannot be opened; the message says what to do.
    """
    scheme, separator, _ = url.partition("://")
    if not separator:
        return open_serial(url, baud)
    if scheme == "tcp":
        return open_tcp(*_address(url))
    if scheme == "rfc2217":
        return open_rfc2217(url, baud)
    raise PortError(f"{url}: a port is a path, tcp://host:port or rfc2217://host:port")


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise PortError(f"{url}: {error}: write tcp://host:port") from error
    if not host or port is None:
        raise PortError(f"{url}: host or port is missing: write tcp://host:port")
    return host, port
