"""The file that keeps counts over a restart: `{"garage/di/5": 1234}`, one line for each count."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bridge.config.names import is_id
from bridge.files import replace_file
from bridge.hub.counts import Key

_MOST_BYTES = 1_000_000  # 32 lines with only counted inputs need a fifth of this
_INPUT = re.compile(r"(?P<station>[a-z0-9_-]+)/di/(?P<channel>[1-9][0-9]?)")
_MOST_EDGES = 10**15


def read_counts(path: Path) -> dict[Key, int]:
    """Return the counts in the file.

    Raises:
        OSError: It cannot be read, or does not exist.
        ValueError: It is damaged; the message says how.
    """
    with path.open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f"it has more than {_MOST_BYTES} bytes")
    try:
        document = json.loads(data)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(document, dict):
        raise ValueError("it is no JSON object")  # noqa: TRY004  # damaged, as far as callers care
    return dict(_entry(name, count) for name, count in document.items())


def write_counts(path: Path, counts: Mapping[Key, int]) -> None:
    """Write all counts or none, even if the power fails meanwhile.

    Raises:
        OSError: They were not written; the old file is unchanged.
    """
    replace_file(path, counts_text(counts))


def counts_text(counts: Mapping[Key, int]) -> bytes:
    """Return counts as the file has them."""
    document = {
        f"{station_id}/di/{channel}": count for (station_id, channel), count in counts.items()
    }
    return json.dumps(document, indent=0).encode() + b"\n"


def _entry(name: str, count: Any) -> tuple[Key, int]:
    match = _INPUT.fullmatch(name)
    if match is None or not is_id(match["station"]):
        raise ValueError(f"{name[:60]!r} is no input")
    if type(count) is not int or not 0 <= count <= _MOST_EDGES:
        raise ValueError(f"{name} has no count")
    return (match["station"], int(match["channel"])), count
