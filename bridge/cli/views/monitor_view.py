"""The output of `monitor`: one line for each piece, and a table of stations at the end."""

import json
import os
from collections.abc import Mapping, Sequence
from typing import TextIO

from bridge.commission.line_statistics import HeardStatistics, StationCounts
from bridge.model import LineProtocol
from bridge.protocol.passive.heard_document import heard_document
from bridge.protocol.passive.listener import Heard, PieceWay

_RED, _YELLOW, _DIM, _PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[2m", "\x1b[0m"
_TEXT_PROTOCOLS = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
_BYTES_WIDTH = 30
_COLUMNS = (
    "station", "requests", "replies", "refused", "no reply", "damaged", "reply p50", "reply max",
)  # fmt: skip


def wants_colour(stream: TextIO, environ: Mapping[str, str]) -> bool:
    """Return whether to use colours: on a terminal, unless NO_COLOR is set."""
    return stream.isatty() and not environ.get("NO_COLOR") and environ.get("TERM") != "dumb"


def line_of(heard: Heard, started: float, *, colour: bool) -> str:
    """Return one line: time, gap, direction, station, bytes, meaning, and problem."""
    gap = "" if heard.gap_s is None else f"+{heard.gap_s * 1000:.1f}"
    who = "" if heard.address is None else f"{heard.address}"
    text = (
        f"{heard.at - started:10.3f} {gap:>9} {heard.way} {who:>3} "
        f"{shown_bytes(heard):<{_BYTES_WIDTH}} {note_of(heard)}"
    )
    return f"{_colour(heard)}{text}{_PLAIN}" if colour and _colour(heard) else text


def json_of(heard: Heard, started: float) -> str:
    """Return one JSON object."""
    return json.dumps({"at": round(heard.at - started, 6), **heard_document(heard)})


def shown_bytes(heard: Heard) -> str:
    """Return text frames as text, others in hex."""
    if heard.protocol in _TEXT_PROTOCOLS:
        return os.fsdecode(heard.data).replace("\r", "\\r").replace("\n", "\\n")
    return heard.data.hex(" ").upper()


def table_of(statistics: HeardStatistics) -> list[Sequence[str]]:
    """Return the counts as rows, the header first."""
    known = sorted(statistics.by_address.items(), key=lambda item: (item[0] is None, item[0] or 0))
    return [_COLUMNS, *(_row(address, counts) for address, counts in known)]


def _row(address: int | None, counts: StationCounts) -> Sequence[str]:
    p50_s = counts.reply_p50_s
    return (
        "?" if address is None else f"{address}",
        f"{counts.requests}",
        f"{counts.replies}",
        f"{counts.refused}",
        f"{counts.unanswered}",
        f"{counts.damaged}",
        "-" if p50_s is None else f"{p50_s * 1000:.1f} ms",
        "-" if p50_s is None else f"{counts.reply_max_s * 1000:.1f} ms",
    )


def note_of(heard: Heard) -> str:
    """Return the meaning, and in brackets the problem."""
    wrong = f"[{heard.problem}]" if heard.problem and heard.problem != heard.meaning else ""
    return " ".join(part for part in (heard.meaning, wrong) if part)


def _colour(heard: Heard) -> str:
    if heard.refused and heard.problem == heard.meaning:
        return _YELLOW
    if heard.problem:
        return _RED
    return _DIM if heard.way is PieceWay.REQUEST else ""
