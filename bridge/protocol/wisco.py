"""Wisco frames for inputs and outputs: RDIH, RDOH, WDOX.

See docs/protocol.md section 2.

A reply carries neither station nor checksum. Only its form can be checked, and this check is
strict: kind, length, characters and terminator.
"""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from bridge.errors import BadReplyError, RefusedError
from bridge.model import DIO100, LAST_ADDRESS, ModuleType
from bridge.protocol.checks import (
    NOISE_CHARS,
    exactly_hex,
    in_range,
    nonempty_mask,
    within_width,
)
from bridge.protocol.expected import Expected

T = TypeVar("T")

INPUTS = b"DI>"
OUTPUTS = b"DO>"
EEPROM = b"EE>"
ERROR = b"ERR="
CR = b"\r"
ERROR_NAMES = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "invalid data frame",
    5: "checksum error",
    6: "invalid number of bytes",
}

_ERROR_CHARS = len(ERROR) + 2
# The first start character counts. If a later one were accepted, two damaged replies could together
# look like one good reply.
_REPLY = re.compile(rb"(DI>|DO>|EE>|ERR=)([^\r]*)\r")
_START = re.compile(rb"DI>|DO>|EE>|ERR=")


@dataclass(frozen=True, slots=True)
class WiscoRequest(ABC, Generic[T]):
    """One request in Wisco frames.

    Each subclass writes its command and reads the body of its reply.

    Attributes:
        address: 0-31.
        frame: The whole frame.
        kind: First characters of the good reply.
        body_chars: Characters between `kind` and the CR.
        reply_chars: Length of the good reply, with the CR.
    """

    address: int
    frame: bytes
    kind: bytes
    body_chars: int
    reply_chars: int = field(init=False, compare=False)
    _expected: Expected = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        reply_chars = len(self.kind) + self.body_chars + len(CR)
        expected = Expected(self.kind, reply_chars, ERROR, _ERROR_CHARS)
        object.__setattr__(self, "reply_chars", reply_chars)
        object.__setattr__(self, "_expected", expected)

    @abstractmethod
    def value(self, body: bytes) -> T:
        """Return the value of the text between kind and CR; raise ValueError if it is wrong."""

    def missing(self, buffer: bytes) -> int:
        """See `Request`."""
        if not buffer:  # every poll asks this first
            return _ERROR_CHARS
        if buffer.startswith(self.kind) and CR not in buffer and len(buffer) < self.reply_chars:
            return self.reply_chars - len(buffer)
        if _REPLY.search(buffer) or self._is_flooded(buffer):
            return 0
        if start := _START.search(buffer):
            # Of a frame that is not for us, or is too long, only the CR is certain to come.
            return max(1, self._expected.left(buffer[start.start() :]))
        # The last characters may be the beginning of a reply, or noise.
        tails = (buffer[max(0, len(buffer) - size) :] for size in range(len(ERROR)))
        return min(left for tail in tails if (left := self._expected.left(tail)) > 0)

    def decode(self, buffer: bytes) -> T | None:
        """See `Request`."""
        if found := _REPLY.search(buffer):
            return self._judge(found[1], found[2], buffer)
        if self._is_flooded(buffer):
            raise BadReplyError(f"{len(buffer)} bytes without a reply", buffer)
        return None

    def _judge(self, kind: bytes, body: bytes, buffer: bytes) -> T:
        if kind == ERROR:
            raise _refusal(body, buffer)
        if kind != self.kind:
            raise BadReplyError(f"{kind.decode()} came where {self.kind.decode()} is due", buffer)
        try:
            return self.value(body)
        except ValueError as error:
            raise BadReplyError(str(error), buffer) from None

    def _is_flooded(self, buffer: bytes) -> bool:
        return len(buffer) > self.reply_chars + NOISE_CHARS


def _refusal(digit: bytes, buffer: bytes) -> RefusedError | BadReplyError:
    for code, name in ERROR_NAMES.items():
        if digit == b"%d" % code:
            return RefusedError(code, name)
    return BadReplyError("no such error code", buffer)


def request_frame(address: int, command: str) -> bytes:
    """Return a whole request. Only the codecs write `command`, never a user."""
    in_range("station", address, 0, LAST_ADDRESS)
    return f"#{address:02X}{command}\r".encode("ascii")


class _HexRead(WiscoRequest[int]):
    __slots__ = ()

    def value(self, body: bytes) -> int:
        return int(exactly_hex(body, self.body_chars), 16)


class WiscoWrite(WiscoRequest[None]):
    """A write, which is answered with `OK`."""

    __slots__ = ()

    def __init__(self, address: int, command: str, kind: bytes) -> None:
        super().__init__(address, request_frame(address, command), kind, len("OK"))

    def value(self, body: bytes) -> None:
        """Return nothing; raise ValueError if it is not `OK`."""
        if body != b"OK":
            raise ValueError(f"{body!r} came where OK is due")


class ReadInputsHex(_HexRead):
    """RDIH: all inputs, four to a character. A DO100 refuses it."""

    __slots__ = ()

    def __init__(self, address: int) -> None:
        super().__init__(address, request_frame(address, "RDIH"), INPUTS, DIO100.inputs // 4)


class ReadOutputsHex(_HexRead):
    """RDOH: all outputs of `module`, four to a character."""

    __slots__ = ()

    def __init__(self, address: int, module: ModuleType) -> None:
        super().__init__(address, request_frame(address, "RDOH"), OUTPUTS, module.outputs // 4)


class WriteOutputsMasked(WiscoWrite):
    """WDOX: the outputs in `mask` become `values`, all at once."""

    __slots__ = ()

    def __init__(self, address: int, module: ModuleType, mask: int, values: int) -> None:
        nonempty_mask(mask, module.outputs)
        within_width("values", values, module.outputs)
        digits = module.outputs // 4
        super().__init__(address, f"WDOX{mask:0{digits}X},{values:0{digits}X}", OUTPUTS)
