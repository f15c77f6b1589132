"""The message about a port that another program has, which is usually the bridge."""

import os
import shlex
from collections.abc import Callable
from pathlib import Path

from bridge.config.load import find_config, load_config
from bridge.config.schema import Config, LineConfig
from bridge.errors import ConfigError, PortBusyError
from bridge.transport.opener import open_port, same_port
from bridge.transport.port import Port


def through_the_bridge(error: PortBusyError, command: str, config: Path | None) -> PortBusyError:
    """Return the error with a command that does the same through the bridge.

    `command` is a command line without its beginning; `config` is the file that it needs.
    """
    words = "wisco2mqtt" + (f" -c {shlex.quote(str(config))}" if config else "")
    return PortBusyError(f"{error}; or, if that is the bridge, go through it: {words} {command}")


def open_or_offer(url: str, baud: int, config: Path | None, command: Callable[[str], str]) -> Port:
    """Open a port; if another program has it, name the command that goes through the bridge.

    `command` makes that command of the id of the line; `config` is the file that `-c` named.
    """
    try:
        return open_port(url, baud)
    except PortBusyError as error:
        path, line = line_at(url, config)
        raise through_the_bridge(error, command(line.id if line else "LINE"), path) from error


def not_while_it_runs(error: PortBusyError) -> PortBusyError:
    """Return the error with the way to stop the bridge, for a command that needs the port."""
    return PortBusyError(
        f"{error}; if that is the bridge: sudo systemctl stop wisco2mqtt, and start it afterwards"
    )


def line_at(port: str, explicit: Path | None) -> tuple[Path | None, LineConfig | None]:
    """Return the configuration that is found, and its line at a port; None: there is none."""
    try:
        path = find_config(explicit)
        config: Config = load_config(path, os.environ, secrets=False)
    except ConfigError:
        return None, None
    for line in config.lines:
        if same_port(line.port, port):
            return path, line
    return None, None
