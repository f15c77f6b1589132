"""Times on a line: characters, silences and time-outs; and an exact sleep."""

import time
from dataclasses import dataclass

from bridge.clock import boot_s
from bridge.config.schema import LineConfig
from bridge.model import LineProtocol

_BITS_PER_CHAR = 10  # docs/protocol.md section 1: 1 start, 8 data, no parity, 1 stop
_RTU_SILENCE_CHARS = 3.5
_RTU_LEAST_SILENCE_S = 0.00175  # above 19200 baud
# Added to the time on the wire: adapters, networks and this computer are sometimes late.
_MARGIN_S = 0.1
_OVERSLEPT_S = 0.0001


@dataclass(frozen=True, slots=True)
class LineTiming:
    """The times of one line.

    Attributes:
        baud: Bits a second.
        turnaround_s: From the end of a request to the start of the reply.
        silence_s: The silence that we keep before each request.
        end_silence_s: The silence after which a module takes a request as complete.
        fixed_timeout_s: The configured time-out of every exchange; None: it is computed.
        margin_s: Added to a computed time-out.
    """

    baud: int
    turnaround_s: float
    silence_s: float
    end_silence_s: float
    fixed_timeout_s: float | None = None
    margin_s: float = _MARGIN_S

    @classmethod
    def from_config(cls, line: LineConfig) -> "LineTiming":
        """Return the times of a configured line; what is not configured is computed."""
        rtu = line.protocol is LineProtocol.MODBUS_RTU
        end_silence_s = rtu_silence_s(line.baud) if rtu else 0.0
        return cls(
            baud=line.baud,
            turnaround_s=line.turnaround_s,
            silence_s=end_silence_s if line.silence_s is None else line.silence_s,
            end_silence_s=end_silence_s,
            fixed_timeout_s=line.timeout_s,
        )

    @property
    def char_s(self) -> float:
        """Return the time of one character on the wire."""
        return _BITS_PER_CHAR / self.baud

    def timeout_s(
        self, request_chars: int, reply_chars: int, turnaround_s: float | None = None
    ) -> float:
        """Return how long an exchange may take, from the first byte of its request.

        `turnaround_s` is that of the module, if it is known.
        """
        if self.fixed_timeout_s is not None:
            return self.fixed_timeout_s
        wire_s = (request_chars + reply_chars) * self.char_s
        known_s = self.turnaround_s if turnaround_s is None else turnaround_s
        return wire_s + self.end_silence_s + known_s + self.margin_s

    def floor_s(self, request_chars: int, reply_chars: int) -> float:
        """Return the shortest time of an exchange (docs/protocol.md section 5)."""
        wire_s = (request_chars + reply_chars) * self.char_s
        return wire_s + self.end_silence_s + self.silence_s + self.turnaround_s


def sleep_exactly(seconds: float) -> None:
    """Sleep, and end neither early nor much later.

    A plain sleep ends some tens of microseconds late, and every silence of every exchange would
    lose that time. So the last part of the wait is a loop that reads the clock.
    """
    until = boot_s() + seconds
    if seconds > _OVERSLEPT_S:
        time.sleep(seconds - _OVERSLEPT_S)
    while boot_s() < until:
        pass


def rtu_silence_s(baud: int) -> float:
    """Return the silence that separates RTU frames (docs/protocol.md section 5)."""
    # Up to 19200 baud 3.5 characters take longer than this minimum.
    return max(_RTU_SILENCE_CHARS * _BITS_PER_CHAR / baud, _RTU_LEAST_SILENCE_S)
