"""Brokers and serial ports: hosts, URLs and device paths."""

import os
import re
from dataclasses import dataclass

from bridge.config.nodes import Place, Reader, WrongValueError
from bridge.config.schema import Server
from bridge.config.shapes import shaped
from bridge.config.text import TEXT, located, text

MAX_PORT = 65535

_ENDPOINT = re.compile(
    r"(?P<scheme>[a-z0-9]+)://(?P<host>\[[^\s/@?#\[\]]+\]|[^\s/:@?#\[\]]+)(?::(?P<port>[1-9][0-9]{0,4}))?"
)
_SERVER = re.compile(
    r"(?P<host>\[[^\s/@?#\[\]]+\]|[^\s/:@?#\[\]]{1,253})(?::(?P<port>[1-9][0-9]{0,4}))?"
)
_HOST = re.compile(r"[^\s/@?#\[\]]{1,253}")
_LINK = re.compile(r"(?:https?|homeassistant)://[^\s/]\S*")

BROKER_PORTS = {"mqtt": 1883, "mqtts": 8883}
_LINE_SCHEMES = ("tcp", "rfc2217")


@dataclass(frozen=True, slots=True)
class PlainUrl:
    """A URL of only scheme, host and port."""

    scheme: str
    host: str
    port: int


def broker_url(place: Place) -> PlainUrl:
    """Read `mqtt://host`, `mqtts://host:port`; the port has a default."""
    written = text(place)
    if "@" in written:
        # Not shown: the text before the @ is a password.
        raise WrongValueError("no credentials in the url; write them as username and password")
    found = _ENDPOINT.fullmatch(written.removesuffix("/"))
    if found is None or found["scheme"] not in BROKER_PORTS or not _port_fits(found["port"]):
        raise WrongValueError(
            f"{place.shown} is not the address of a broker; "
            "write it like mqtt://host, mqtts://host or mqtts://host:8883"
        )
    port = int(found["port"] or BROKER_PORTS[found["scheme"]])
    return PlainUrl(found["scheme"], found["host"].strip("[]"), port)


def host_name(place: Place) -> str:
    """Read a host name or an IP address, without a port."""
    host = text(place)
    if "://" in host:
        raise WrongValueError("is a URL; write it as url: instead of host:")
    # An IPv6 address has at least two colons.
    if not _HOST.fullmatch(host) or host.count(":") == 1:
        raise WrongValueError(
            f"{place.shown} is not a host name or an IP address; a port goes into port:"
        )
    return host


def server(default_port: int) -> Reader[Server]:
    """Make a reader of one server of a cluster: `host` or `host:port`, without a scheme."""

    def read(place: Place) -> Server:
        written = text(place)
        found = _SERVER.fullmatch(written)
        if found is None or not _port_fits(found["port"]):
            raise WrongValueError(
                f"{place.shown} is not a server; write it like 10.0.0.2, broker.lan:1884 or "
                "[fd00::2]:1883, without mqtt:// in front of it"
            )
        return Server(found["host"].strip("[]"), int(found["port"] or default_port))

    return shaped(read, TEXT)


def line_port(place: Place) -> str:
    """Read the port of a line: a device, or a serial gateway on the network.

    `./panel` starts at the folder of the configuration file, `~/panel` at home.
    """
    written = text(place)
    if written.startswith("/"):
        return written
    if written.startswith(("./", "../", "~/")):
        return os.path.normpath(located(place, written))
    found = _ENDPOINT.fullmatch(written)
    if found is None or found["scheme"] not in _LINE_SCHEMES or not found["port"]:
        raise WrongValueError(
            f"{place.shown} is not a port; write an absolute path such as /dev/ttyUSB0, "
            "tcp://host:port or rfc2217://host:port"
        )
    if not _port_fits(found["port"]):
        raise WrongValueError(f"{place.shown} has a port above {MAX_PORT}; correct it")
    return written


def web_link(place: Place) -> str:
    """Read a link for Home Assistant: http, https or homeassistant."""
    link = text(place)
    if not _LINK.fullmatch(link):
        raise WrongValueError(f"{place.shown} is not a link; write it like http://host:port/")
    return link


for _reader in (broker_url, host_name, line_port, web_link):
    shaped(_reader, TEXT)


def _port_fits(port: str | None) -> bool:
    return port is None or int(port) <= MAX_PORT
