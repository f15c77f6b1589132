"""A piece that was heard on a line as a JSON object, and back: for `monitor --json` and `trace`."""

from collections.abc import Mapping
from typing import Any

from bridge.model import LineProtocol
from bridge.protocol.passive.listener import Heard, PieceWay

_NAMES = {PieceWay.REQUEST: "request", PieceWay.REPLY: "reply", PieceWay.UNKNOWN: "unknown"}
_WAYS = {name: way for way, name in _NAMES.items()}


def heard_document(heard: Heard) -> dict[str, Any]:
    """Return everything except the instant: each user writes the time in its own form."""
    return {
        "gap_ms": None if heard.gap_s is None else round(heard.gap_s * 1000, 3),
        "direction": _NAMES[heard.way],
        "protocol": heard.protocol,
        "station": heard.address,
        "bytes": heard.data.hex(),
        "meaning": heard.meaning,
        "problem": heard.problem,
        "reply_ms": None if heard.reply_s is None else round(heard.reply_s * 1000, 3),
    }


def read_heard(document: Mapping[str, Any], at: float) -> Heard:
    """Return the piece that `heard_document` wrote.

    Raises:
        ValueError: It is not such a document.
    """
    try:
        way, data = _WAYS[document["direction"]], bytes.fromhex(document["bytes"])
        meaning, problem = str(document["meaning"]), document["problem"]
        protocol = document["protocol"]
        return Heard(
            at=at,
            gap_s=_seconds(document["gap_ms"]),
            way=way,
            data=data,
            protocol=None if protocol is None else LineProtocol(protocol),
            address=None if document["station"] is None else int(document["station"]),
            meaning=meaning,
            problem=None if problem is None else str(problem),
            reply_s=_seconds(document["reply_ms"]),
            refused=way is PieceWay.REPLY and meaning.startswith("refused"),
            unanswered=way is PieceWay.REPLY and not data,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"nothing that was heard on a line: {error!r}") from error


def _seconds(ms: float | None) -> float | None:
    return None if ms is None else ms / 1000
