"""The message about a port that another program has, which is usually the bridge."""

import os
import shlex
from pathlib import Path

from bridge.config.load import find_config, load_config
from bridge.config.schema import Config, LineConfig
from bridge.errors import ConfigError, PortBusyError
from bridge.transport.opener import same_port


def through_the_bridge(error: PortBusyError, command: str, config: Path | None) -> PortBusyError:
    """Return the error with a command that does the same through the bridge.

    `command` is a command line without its beginning; `config` is the file that it needs.
    """
    words = "wisco2mqtt" + (f" -c {shlex.quote(str(config))}" if config else "")
    return PortBusyError(f"{error}; or, if that is the bridge, go through it: {words} {command}")


def not_while_it_runs(error: PortBusyError) -> PortBusyError:
    """Return the error with the way to stop the bridge, for a command that needs the port."""
    return PortBusyError(
        f"{error}; if that is the bridge: sudo systemctl stop wisco2mqtt, and start it afterwards"
    )


def line_at(port: str, explicit: Path | None) -> tuple[Path | None, LineConfig | None]:
    """Return the configuration that is found, and its line at a port; None: there is none."""
    try:
        path = find_config(explicit)
        config: Config = load_config(path, os.environ)
    except ConfigError:
        return None, None
    for line in config.lines:
        if same_port(line.port, port):
            return path, line
    return None, None
