"""Reads the request to a cover. For any content, the only error is CommandError."""

import re
from collections.abc import Mapping
from typing import Any

from bridge.config.schema import StationConfig
from bridge.errors import CommandError
from bridge.model import CoverCommand, Reason
from bridge.mqtt.strict_json import bad
from bridge.mqtt.topics import CoverTarget

_CLOSED, _OPEN = 0, 100
# The goal of each word; None: stop.
_GOALS: Mapping[str, int | None] = {"OPEN": _OPEN, "CLOSE": _CLOSED, "STOP": None}
COVER_WORDS = "OPEN, CLOSE, STOP"
_PERCENT = re.compile(r"[0-9]{1,3}")


def plain_wish(text: str, target: CoverTarget) -> str | int | None:
    """Return the meaning of a payload without JSON; None: it has none."""
    if target.position:
        return int(text) if _PERCENT.fullmatch(text) else None
    return text if text in _GOALS else None


def goal_of(request: Mapping[str, Any], target: CoverTarget) -> int | None:
    """Return the wanted position, 0 closed to 100 open; None: stop.

    Raises:
        CommandError: It is not a valid request.
    """
    wish = request[target.key]
    if not target.position:
        if not isinstance(wish, str) or wish not in _GOALS:
            raise bad(f"state is none of {COVER_WORDS}")
        return _GOALS[wish]
    if isinstance(wish, bool) or not isinstance(wish, int) or not _CLOSED <= wish <= _OPEN:
        raise bad("position is no whole number from 0 to 100")
    return wish


def cover_command(
    goal: int | None, target: CoverTarget, config: StationConfig, common: Mapping[str, Any]
) -> CoverCommand:
    """Return the command to a cover.

    Raises:
        CommandError: The station has no such cover.
    """
    for cover in config.covers:
        if cover.id == target.cover:
            return CoverCommand(cover=cover.id, mask=cover.outputs, goal=goal, **common)
    raise CommandError(Reason.NO_SUCH_CHANNEL, f"no cover {target.cover!a:.60}")
