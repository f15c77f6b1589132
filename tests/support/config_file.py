"""Writes a configuration into a folder and loads it: a valid file with room for one more key."""

from pathlib import Path

from bridge.config.load import load_config
from bridge.config.schema import Config
from bridge.errors import ConfigError

HOME = "/home/wisco"

STATION = "{address: 1, model: DIO100}"


def file_with(
    *, top: str = "", line: str = "", station_keys: str = "", model: str = "DIO100"
) -> str:
    """Gives a valid configuration with further keys at the top, in its line or its station."""
    return "\n".join(
        (
            top,
            "lines:",
            f"  - id: main\n    port: /dev/ttyUSB0\n    baud: 9600\n{_indented(line, 4)}",
            "    protocol: wisco" if "protocol:" not in line else "",
            f"    stations:\n      - address: 1\n        model: {model}",
            _indented(station_keys, 8),
        )
    )


def load_text(folder: Path, text: str, **environ: str) -> Config:
    """Loads `text` as a configuration file in `folder`."""
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return load_config(path, {"HOME": HOME, **environ})


def problems_of(folder: Path, text: str, **environ: str) -> list[str]:
    """Loads `text` and gives its problems as `LINE:COLUMN message`."""
    try:
        load_text(folder, text, **environ)
    except ConfigError as error:
        return [f"{found.line}:{found.column} {found.message}" for found in error.problems]
    return []


def _indented(text: str, spaces: int) -> str:
    return "\n".join(" " * spaces + line for line in text.splitlines())
