"""Follows the conversation on a line: requests, replies and faults. Time is an argument.

A Modbus frame does not say whether it is a request or a reply. Most frames can be told apart by
their form, the others by the request before them.
"""

from dataclasses import dataclass
from enum import StrEnum

from bridge.model import LineProtocol
from bridge.protocol.modbus import EXCEPTION_FLAG
from bridge.protocol.passive.frames import (
    FrameFinder,
    ModbusPassed,
    Piece,
    StrayBytes,
    WiscoAsked,
    WiscoSaid,
)
from bridge.protocol.passive.words import (
    modbus_reply,
    modbus_request,
    wisco_fault,
    wisco_reply,
    wisco_request,
)

# Bytes come in bursts: adapters hold them for 16 ms, and 16 characters take 33 ms at 4800 baud.
QUIET_S = 0.1
# The reply to a write can equal the request. A repeated request is equal too, but it comes later:
# masters wait 100 ms or more before they repeat.
_ECHO_WITHIN_S = 0.1
# After this time without a reply the module counts as silent.
_ANSWER_WITHIN_S = 1.0
_READS = frozenset({0x01, 0x02, 0x03, 0x04})
_SINGLE_WRITES = frozenset({0x05, 0x06})
_SHORT_PDU = 5  # function and two words
_BROADCAST = 0


class PieceWay(StrEnum):
    """The direction of a piece."""

    REQUEST = ">"
    REPLY = "<"
    UNKNOWN = "?"


@dataclass(frozen=True, slots=True)
class Heard:
    """One piece of the conversation.

    Attributes:
        at: When its last byte came; for a missing reply, when it was clear that it is missing.
        gap_s: The time since the last piece; None: this is the first.
        way: Request, reply, or unknown.
        data: Its bytes; empty for a missing reply.
        protocol: The protocol; None: it is not a frame.
        address: The address in the frame; for a Wisco reply, the one that was asked. None: unknown.
        meaning: Its meaning in words.
        problem: What is wrong, or None.
        reply_s: For a reply: the time since its request.
        refused: The module refused.
        unanswered: It stands for a missing reply.
    """

    at: float
    gap_s: float | None
    way: PieceWay
    data: bytes
    protocol: LineProtocol | None
    address: int | None
    meaning: str
    problem: str | None = None
    reply_s: float | None = None
    refused: bool = False
    unanswered: bool = False


@dataclass(slots=True)
class _Open:
    """A request that waits for its reply."""

    at: float
    address: int
    piece: WiscoAsked | ModbusPassed
    disturbed: bool = False  # damaged bytes came


class Listener:
    """The conversation on one line. One thread owns it."""

    def __init__(self) -> None:
        self._finder = FrameFinder()
        self._open: _Open | None = None
        self._bytes_at = 0.0
        self._sent: bool | None = None
        self._last_at: float | None = None

    def hear(self, data: bytes, now: float, *, sent: bool | None = None) -> list[Heard]:
        """Return the pieces that these bytes complete; they came at `now`.

        `sent`: True if they went to the modules, False if they came from them, None if it is not
        known.
        """
        heard = self.pass_time(now)
        if sent is not self._sent:
            heard += self._cut()
            self._sent = sent
        self._bytes_at = now
        for piece in self._finder.feed(data):
            heard += self._follow(piece, now)
        return heard

    def pass_time(self, now: float) -> list[Heard]:
        """Return what the silence until `now` decides: a broken frame, or a missing reply."""
        heard: list[Heard] = []
        if now - self._bytes_at >= QUIET_S:
            heard += self._cut()
        if self._open and now - self._open.at >= _ANSWER_WITHIN_S:
            heard += self._give_up(now)
        return heard

    def end(self) -> list[Heard]:
        """Return the unfinished frame when the listening ends."""
        return self._cut()

    def _cut(self) -> list[Heard]:
        """Return the pieces of an unfinished frame: it will not be completed."""
        heard: list[Heard] = []
        if self._finder.holding:
            for piece in self._finder.fall_silent():
                heard += self._follow(piece, self._bytes_at)
        return heard

    def _follow(self, piece: Piece, at: float) -> list[Heard]:
        if isinstance(piece, StrayBytes):
            return [self._noise(piece, at)]
        if isinstance(piece, WiscoSaid):
            return [self._wisco_reply(piece, at)]
        if isinstance(piece, ModbusPassed) and self._answers(piece, at):
            return [self._modbus_reply(piece, at)]
        return self._request(piece, at)

    # --- requests ---

    def _request(self, piece: WiscoAsked | ModbusPassed, at: float) -> list[Heard]:
        heard = self._give_up(at)
        if isinstance(piece, WiscoAsked):
            protocol, meaning, silent = LineProtocol.WISCO, wisco_request(piece.command), False
        else:
            protocol, meaning = piece.protocol, modbus_request(piece.pdu)
            silent = piece.address == _BROADCAST
        self._open = None if silent else _Open(at, piece.address, piece)
        gap_s = self._gap(at)
        heard.append(
            Heard(at, gap_s, PieceWay.REQUEST, piece.data, protocol, piece.address, meaning)
        )
        return heard

    def _give_up(self, at: float) -> list[Heard]:
        """Close a request without a reply; a damaged reply to it was returned already."""
        missed, self._open = self._open, None
        if missed is None or missed.disturbed:
            return []
        problem = f"station {missed.address} did not answer"
        protocol = (
            missed.piece.protocol if isinstance(missed.piece, ModbusPassed) else LineProtocol.WISCO
        )
        return [
            Heard(
                at,
                None,
                PieceWay.REPLY,
                b"",
                protocol,
                missed.address,
                "",
                problem,
                unanswered=True,
            )
        ]

    # --- replies ---

    def _answers(self, piece: ModbusPassed, at: float) -> bool:
        """Return whether a frame is a reply and not a request."""
        if self._sent is not None:
            return not self._sent
        function, asked = piece.pdu[0], self._asked_in_modbus()
        if function & EXCEPTION_FLAG:
            return True
        short = len(piece.pdu) == _SHORT_PDU
        if function in _READS:
            same = asked is not None and asked.pdu[0] == function and piece.pdu[1] == _SHORT_PDU - 2
            return not short or (same and asked is not None and asked.address == piece.address)
        if function in _SINGLE_WRITES:
            same = asked is not None and asked.data == piece.data
            return same and self._open is not None and at - self._open.at < _ECHO_WITHIN_S
        return short

    def _modbus_reply(self, piece: ModbusPassed, at: float) -> Heard:
        asked = self._asked_in_modbus()
        problem = self._strangeness(piece, asked)
        fits = asked is not None and problem is None
        meaning = modbus_reply(piece.pdu, asked.pdu if asked and fits else None)
        refused = bool(piece.pdu[0] & EXCEPTION_FLAG)
        reply_s = self._close(at, fits)
        gap_s = self._gap(at)
        return Heard(
            at,
            gap_s,
            PieceWay.REPLY,
            piece.data,
            piece.protocol,
            piece.address,
            meaning,
            problem or (meaning if refused else None),
            reply_s,
            refused,
        )

    def _strangeness(self, piece: ModbusPassed, asked: ModbusPassed | None) -> str | None:
        if asked is None:
            return "this was not requested"
        if asked.address != piece.address:
            return f"station {piece.address} answered for station {asked.address}"
        if asked.pdu[0] != piece.pdu[0] & ~EXCEPTION_FLAG:
            return f"function {piece.pdu[0]:02X} answered function {asked.pdu[0]:02X}"
        return None

    def _wisco_reply(self, piece: WiscoSaid, at: float) -> Heard:
        asked = self._open.piece if self._open else None
        address = asked.address if isinstance(asked, WiscoAsked) else None
        problem = wisco_fault(piece.kind, piece.body)
        if address is None:
            problem = "this was not requested"
        meaning = wisco_reply(piece.kind, piece.body)
        refused = piece.kind == "ERR="
        reply_s = self._close(at, problem is None)
        gap_s = self._gap(at)
        return Heard(
            at,
            gap_s,
            PieceWay.REPLY,
            piece.data,
            LineProtocol.WISCO,
            address,
            meaning,
            problem or (meaning if refused else None),
            reply_s,
            refused,
        )

    def _noise(self, piece: StrayBytes, at: float) -> Heard:
        if self._open:
            self._open.disturbed = True
        address = self._open.address if self._open else None
        gap_s = self._gap(at)
        return Heard(at, gap_s, PieceWay.UNKNOWN, piece.data, None, address, "", piece.reason)

    def _asked_in_modbus(self) -> ModbusPassed | None:
        piece = self._open.piece if self._open else None
        return piece if isinstance(piece, ModbusPassed) else None

    def _close(self, at: float, fits: bool) -> float | None:
        """Close the open request if a reply fits it; return how long the reply took."""
        if self._open is None:
            return None
        if not fits:
            self._open.disturbed = True
            return None
        reply_s = at - self._open.at
        self._open = None
        return reply_s

    def _gap(self, at: float) -> float | None:
        gap_s = None if self._last_at is None else at - self._last_at
        self._last_at = at
        return gap_s
