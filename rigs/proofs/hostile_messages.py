"""Messages that no well-meaning sender publishes, and that ask for nothing."""

import json
import random
from dataclasses import dataclass
from typing import Any

_WORDS = ("ON", "OFF", "TOGGLE", "PRESS")
_SEEDS = (
    *(word.encode() for word in _WORDS),
    b'{"state": "ON", "id": "x1", "deadline": 1.5}',
    b'{"do": {"1": "ON", "4": "OFF"}, "id": 7}',
    b"#01WDO1,1\r",
    b":01050000FF00FA\r\n",
    b'{"state": "\\ud800"}',
    b"[" * 3000,
    b'{"a":' * 900,
    b"1e999999",
    b"-" + b"9" * 4000,
    b"NaN",
    b"\xff",
    b"\x00",
    b"",
    b"online",
    b"offline",
)
_LEVELS = ("garage", "pumps", "bridge", "do", "di", "1", "8", "01", "\u0661", "", "set", "state")


@dataclass(frozen=True, slots=True)
class Hostile:
    """One message."""

    topic: str
    payload: bytes
    retain: bool


def hostile(chance: random.Random, base: str, commands: tuple[str, ...]) -> Hostile:
    """One message for the bridge at `base`, or for one of its command topics."""
    payload = _payload(chance)
    while _asks_for_something(payload):
        payload = _payload(chance)
    # What is retained and not empty stays at the broker: seldom, so that it stays little.
    return Hostile(_topic(chance, base, commands), payload, retain=chance.random() < 0.02)


def _topic(chance: random.Random, base: str, commands: tuple[str, ...]) -> str:
    kind = chance.random()
    if kind < 0.7:
        return chance.choice(commands)
    if kind < 0.75:
        return f"{base}/bridge/{chance.choice(('ping', 'state', 'set', 'log'))}"
    levels = [chance.choice(_LEVELS) for _ in range(chance.randint(0, 3))]
    if kind > 0.95:
        levels.append(_text(chance))
    return "/".join([base, *levels, "set"])


def _text(chance: random.Random) -> str:
    """Characters that a topic may hold, of every script."""
    points = (chance.randrange(0x20, 0xD7FF) for _ in range(chance.randint(1, 60)))
    return "".join(c for c in map(chr, points) if c not in "+#\x7f" and c.isprintable())


def _payload(chance: random.Random) -> bytes:
    kind = chance.random()
    if kind < 0.3:
        return chance.randbytes(chance.randint(0, 64))
    seed = chance.choice(_SEEDS)
    if kind < 0.4:
        return seed
    damaged = bytearray(seed[:200])
    for _ in range(chance.randint(1, 3)):
        at = chance.randint(0, len(damaged))
        damaged[at : at + chance.randint(0, 2)] = chance.randbytes(chance.randint(0, 2))
    return bytes(damaged)


def _asks_for_something(payload: bytes) -> bool:
    """Return whether it could be taken for a command: a word, or an object that holds one."""
    try:
        text = payload.decode()
        wish: Any = text if text in _WORDS else json.loads(text)
    except (ValueError, RecursionError):
        return False
    asked = wish.get("state", wish.get("do")) if isinstance(wish, dict) else wish
    values = asked.values() if isinstance(asked, dict) else [asked]
    return any(isinstance(value, str) and value in _WORDS for value in values)
