"""The section `web`: the panel in the browser."""

import ipaddress
import re

from bridge.config.endpoints import MAX_PORT
from bridge.config.nodes import Place, WrongValueError
from bridge.config.scalars import boolean
from bridge.config.schema import WebConfig
from bridge.config.shapes import shaped
from bridge.config.tables import Table, table_of
from bridge.config.text import TEXT, credential, text

_LISTEN = re.compile(r"(?P<host>\[[0-9a-fA-F:.]+\]|[0-9.]+|localhost):(?P<port>[1-9][0-9]{0,4})")
_DEFAULT = ("127.0.0.1", 8099)
_KEYS = ("password", "token", "read_token")


def read_web(place: Place) -> WebConfig:
    """Read the section `web`."""
    with table_of(place) as table:
        host, port = table.get("listen", listen_address, _DEFAULT)
        config = WebConfig(
            host=host,
            port=port,
            password=table.get("password", credential, None),
            token=table.get("token", credential, None),
            read_token=table.get("read_token", credential, None),
            read_only=table.get("read_only", boolean, False),
            proxy=table.get("proxy", _proxy, None),
        )
        _check(config, table)
    return config


def listen_address(place: Place) -> tuple[str, int]:
    """Read where the panel listens: the address of an interface, and a port."""
    found = _LISTEN.fullmatch(text(place))
    host = found["host"].strip("[]") if found else ""
    if found is None or int(found["port"]) > MAX_PORT or not _is_host(host):
        raise WrongValueError(
            f"{place.shown} is not where to listen; write an IP address and a port, like "
            "127.0.0.1:8099, 0.0.0.0:8099 (all of IPv4) or '[::1]:8099'"
        )
    return host, int(found["port"])


def _proxy(place: Place) -> str:
    """Read the address that a proxy comes from."""
    address = text(place)
    if not is_address(address):
        raise WrongValueError(f"{place.shown} is not the IP address of a proxy; write it so")
    return str(ipaddress.ip_address(address))


for _reader in (listen_address, _proxy):
    shaped(_reader, TEXT)


def _check(config: WebConfig, table: Table) -> None:
    _check_library(table)
    if not is_loopback(config.host) and "password" not in table:
        table.problem(
            "listen",
            "other machines reach the panel there; write a password, or listen on 127.0.0.1",
        )
    if config.proxy is not None and "password" not in table:
        table.problem("proxy", "a proxy brings the requests of others; write a password")
    for number, key in enumerate(_KEYS):
        value = getattr(config, key)
        if value and value in [getattr(config, other) for other in _KEYS[:number]]:
            table.problem(key, f"{key} is one of the other keys too; write another")


def _check_library(table: Table) -> None:
    # Imported here: a daemon without a panel needs none of it, and it takes a megabyte.
    from importlib.util import find_spec  # noqa: PLC0415

    if find_spec("microdot") is None:
        from bridge.installed import how_to_add  # noqa: PLC0415

        table.problem(
            "listen",
            f"the panel's library microdot is missing (extra `web`): {how_to_add('microdot')}; or "
            "take web out",
        )


def is_loopback(host: str) -> bool:
    """Return whether an address is reached from this machine alone."""
    return host == "localhost" or (is_address(host) and ipaddress.ip_address(host).is_loopback)


def is_address(host: str) -> bool:
    """Return whether this is an IP address, not a name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _is_host(host: str) -> bool:
    return host == "localhost" or is_address(host)
