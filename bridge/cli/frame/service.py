"""The configuration of the service, read by a command: it finds the service's own files."""

import os
from pathlib import Path

from bridge.config.load import config_of, read_text
from bridge.config.schema import Config

_OF_THE_SERVICE = Path("/etc/wisco2mqtt")
_ITS_STATE = "/var/lib/wisco2mqtt"  # StateDirectory= of the unit


def load_with_state(path: Path) -> Config:
    """Return the configuration at `path`; its `state_dir` is that of the bridge that runs with it.

    Raises:
        ConfigError: As `load_config`.
    """
    return config_with_state(read_text(path), path)


def config_with_state(text: str, path: Path) -> Config:
    """Return the configuration that `text` is, as `load_with_state` with that text at `path`.

    Raises:
        ConfigError: As `load_config`.
    """
    state = {"STATE_DIRECTORY": _ITS_STATE} if path.parent == _OF_THE_SERVICE else {}
    return config_of(text, path, {**state, **os.environ}, secrets=False)
