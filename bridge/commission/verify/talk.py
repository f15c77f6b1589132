"""Asks one module until its answers agree, and tells what they were. Reads alone are asked."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bridge.commission.verify.line import VerifiedLine
from bridge.drivers import driver_for
from bridge.drivers.driver import Driver
from bridge.errors import BadReplyError, NoReplyError, RefusedError
from bridge.model import LineProtocol, ModuleType
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import Pdu
from bridge.protocol.request import Request
from bridge.protocol.rtu import RtuRequest
from bridge.protocol.wisco import request_frame

# With one reply in a hundred lost, all of four are lost once in a hundred million times.
_ASKS = 6
_SILENT_ASKS = 4
_AGREE = 2
_LONGEST_RAW = 1100
SILENT = ""


@dataclass(frozen=True, slots=True)
class RawRead:
    """A read whose reply is taken as it comes, up to the byte that ends it: so its form shows."""

    address: int
    frame: bytes
    end: bytes
    reply_chars: int

    def missing(self, buffer: bytes) -> int:
        """See `Request`."""
        return 0 if buffer.endswith(self.end) or len(buffer) > _LONGEST_RAW else 1

    def decode(self, buffer: bytes) -> bytes:
        """See `Request`."""
        return buffer


@dataclass(frozen=True, slots=True)
class Talk:
    """One module on a line."""

    line: VerifiedLine
    protocol: LineProtocol
    baud: int
    address: int
    model: ModuleType

    @property
    def is_text(self) -> bool:
        """Return whether switch 8 is ON: it should take Wisco and Modbus ASCII frames."""
        return self.protocol is not LineProtocol.MODBUS_RTU

    @property
    def takes_modbus(self) -> bool:
        """Return whether a Modbus frame can call it: 0 is no station there."""
        return self.address != 0

    @property
    def driver(self) -> Driver:
        """Return its driver in the line's own protocol."""
        return driver_for(self.protocol, self.address, self.model)

    def modbus(self, pdu: Pdu[Any]) -> Request[Any]:
        """Return a Modbus read in the frames of this line."""
        return AsciiRequest(self.address, pdu) if self.is_text else RtuRequest(self.address, pdu)

    def wisco(self, command: str, chars: int = 64) -> bytes:
        """Ask a Wisco read and return all that came, with what followed its CR."""
        request = RawRead(self.address, request_frame(self.address, command), b"\r", chars)
        heard = self._raw(request)
        return heard + self.line.strays() if heard else heard

    def ascii(self, pdu: Pdu[Any], chars: int = 64) -> bytes:
        """Ask in Modbus ASCII and return all that came."""
        frame = AsciiRequest(self.address, pdu).frame
        return self._raw(RawRead(self.address, frame, b"\n", chars))

    def answer(self, request: Request[Any], *, protected: bool) -> str | None:
        """Return `read`, or `code n`; SILENT; None: it cannot be read."""
        try:
            self.line.exchange(request, protected=protected)
        except RefusedError as error:
            return f"code {error.code}"
        except NoReplyError:
            return SILENT
        except BadReplyError as error:
            return None if len(error.data) else SILENT
        return "read"

    def _raw(self, request: RawRead) -> bytes:
        try:
            return self.line.exchange(request, protected=False)
        except NoReplyError:
            return b""
        except BadReplyError as error:
            return error.data


def agreed(ask: Callable[[], str | None]) -> str | None:
    """Ask until two answers are equal; SILENT: there was never one; None: they do not agree."""
    said: Counter[str] = Counter()
    silent = 0
    for _ in range(_ASKS):
        answer = ask()
        if answer == SILENT:
            silent += 1
            if silent == _SILENT_ASKS and not said:
                return SILENT
        elif answer is not None:
            said[answer] += 1
            if said[answer] == _AGREE:
                return answer
    return None
