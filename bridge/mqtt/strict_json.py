"""Reads JSON from other programs; bytes of any kind make no error other than CommandError."""

import json
from collections import Counter
from typing import Any

from bridge.errors import CommandError
from bridge.model import Reason

MOST_BYTES = 4096  # sixteen outputs, an id and a deadline take less than 500
_MARK_CHARS = 128
_ERROR_CHARS = 256


class JsonObject(dict[str, Any]):
    """A JSON object that remembers keys that occur more than once."""

    repeated: frozenset[str] = frozenset()


def bad(detail: str) -> CommandError:
    """Return the error for a wrong payload."""
    return CommandError(Reason.BAD_PAYLOAD, detail[:_ERROR_CHARS])


def read_text(payload: bytes) -> str:
    """Return the text of a payload of acceptable length.

    Raises:
        CommandError: It is too long, or not UTF-8.
    """
    if len(payload) > MOST_BYTES:
        raise bad(f"{len(payload)} bytes, at most {MOST_BYTES} are read")
    try:
        return payload.decode("utf-8")
    except UnicodeDecodeError as error:
        raise bad(f"not UTF-8: {error.reason} at byte {error.start}") from None


def read_object(text: str, expected: str = "a JSON object") -> JsonObject:
    """Return one JSON object.

    Raises:
        CommandError: It is not what is `expected`.
    """
    try:
        document = json.loads(text, object_pairs_hook=_object)
    except (ValueError, RecursionError) as error:
        raise bad(f"not {expected}: {error}") from None
    if not isinstance(document, JsonObject):
        raise bad(f"not {expected}")
    return document


def object_of(payload: bytes | str) -> dict[str, Any]:
    """Return the JSON object in a payload; an empty one where there is none."""
    try:
        document = json.loads(payload)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def read_id(document: JsonObject, key: str) -> str | int | None:
    """Read the sender's own id under `key`; None: there is none.

    Raises:
        CommandError: It is none that an answer could repeat.
    """
    if key not in document:
        return None
    value = document[key]
    if key in document.repeated:
        raise bad(f"key '{key}' stands there twice")
    # A bool is an int to Python, but no id.
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise bad(f"{key} is neither a text nor an integer")
    if not 1 <= len(str(value)) <= _MARK_CHARS:
        raise bad(f"{key} has not 1 to {_MARK_CHARS} characters")
    if isinstance(value, str) and any("\ud800" <= char <= "\udfff" for char in value):
        raise bad(f"{key} has no UTF-8 form, so no answer could repeat it")
    return value


def _object(pairs: list[tuple[str, Any]]) -> JsonObject:
    made = JsonObject(pairs)
    if len(made) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        made.repeated = frozenset(key for key, count in counts.items() if count > 1)
    return made
