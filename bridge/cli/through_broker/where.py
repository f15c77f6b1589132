"""Which broker `watch` and `send` go to: that of the configuration, or of flags without one."""

import argparse
import os
from pathlib import Path

from bridge.cli.frame.usage import UsageError, check_stations
from bridge.config.endpoints import BROKER_PORTS, MAX_PORT
from bridge.config.load import find_config, load_config
from bridge.config.names import is_id
from bridge.config.schema import Config, MqttConfig
from bridge.files import read_file

_FLAGS = ("port", "username", "password_file", "base_topic")
_PORT = BROKER_PORTS["mqtt"]
_BASE_TOPIC = "wisco"


def add_broker(parser: argparse.ArgumentParser) -> None:
    """Declare the flags that take the place of a configuration."""
    add = parser.add_argument_group("without a configuration").add_argument
    add("--host", metavar="HOST", help="the broker: no configuration is read then")
    add("--port", type=int, metavar="PORT-NUMBER", help=f"goes with --host (default: {_PORT})")
    add("--username", metavar="NAME", help="goes with --host")
    add("--password-file", type=Path, metavar="FILE", help="goes with --username")
    add("--base-topic", metavar="TOPIC", help=f"goes with --host (default: {_BASE_TOPIC})")


def broker_of(args: argparse.Namespace, station_ids: list[str]) -> tuple[MqttConfig, Config | None]:
    """Return the broker that is meant, and the configuration where one was read.

    Raises:
        UsageError: Flags that make no sense together, or a station that is not configured.
        ConfigError: The configuration is wrong or missing.
    """
    if args.host is not None:
        if wrong := [name for name in station_ids if not is_id(name)]:
            raise UsageError(f"{wrong[0]} cannot be the id of a station: a-z, 0-9, - and _")
        return _from_flags(args), None
    if given := [flag for flag in _FLAGS if getattr(args, flag) is not None]:
        raise UsageError(f"--{given[0].replace('_', '-')} goes with --host")
    config = load_config(find_config(args.config), os.environ)
    check_stations(station_ids, config)
    return config.mqtt, config


def _from_flags(args: argparse.Namespace) -> MqttConfig:
    port = _PORT if args.port is None else args.port
    topic = args.base_topic or _BASE_TOPIC
    if not 0 < port <= MAX_PORT:
        raise UsageError(f"port {port} is not one of 1-{MAX_PORT}")
    if not all(map(is_id, topic.split("/"))):
        raise UsageError(f"{topic} cannot be a base topic: write it like wisco or home/wisco")
    if args.password_file is not None and args.username is None:
        raise UsageError("--password-file goes with --username")
    return MqttConfig(
        host=args.host,
        port=port,
        base_topic=topic,
        client_id="wisco2mqtt",
        protocol="auto",
        username=args.username,
        password=None if args.password_file is None else _password(args.password_file),
    )


def _password(path: Path) -> str:
    try:
        return read_file(path).decode().removesuffix("\n").removesuffix("\r")
    except OSError as error:
        raise UsageError(f"{path} cannot be read ({error.strerror})") from error
    except UnicodeDecodeError:
        raise UsageError(f"{path} is not UTF-8 text") from None
