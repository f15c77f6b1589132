"""Counts the lines of the daemon's log by kind, and by the steady fault that they are about."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

_HEAD = re.compile(r"^\S+ (?P<level>[A-Z]+) \S+: ")
# What differs between two lines of one kind: numbers, bytes, devices.
_VARYING = re.compile(r"/dev/\S+|/tmp/\S+|\b[0-9a-f]{2}( [0-9a-f]{2})+\b|\d+([.,:]\d+)*")
_SHOWN_CHARS = 90


def kinds(log: Path) -> Counter[str]:
    """Return the number of lines of each kind."""
    return Counter(_kind(line) for line in _lines(log))


def about(log: Path, names: Sequence[str]) -> Counter[str]:
    """Return the number of lines about each station, without those about commands to it."""
    found = Counter(dict.fromkeys(names, 0))
    for line in _lines(log):
        found.update(name for name in names if f"({name})" in line)
    return found


def _kind(line: str) -> str:
    head = _HEAD.match(line)
    level, text = (head["level"], line[head.end() :]) if head else ("?", line)
    shown = f"{level} {_VARYING.sub('#', text)}"[:_SHOWN_CHARS]
    return "".join(char if char.isprintable() else "?" for char in shown)


def _lines(log: Path) -> Iterable[str]:
    with log.open(errors="replace") as lines:
        for line in lines:
            yield line.rstrip("\n")
