"""The requests of a scan, their order and their time. Pure arithmetic."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from bridge.drivers import driver_for
from bridge.drivers.driver import Driver
from bridge.model import DIO100, LAST_ADDRESS, LineProtocol
from bridge.protocol.modbus import FIRST_ADDRESS
from bridge.transport.timing import LineTiming, rtu_silence_s

T = TypeVar("T")

# The most probable first: new panels are usually set to 9600 baud.
BAUDS = (9600, 19200, 57600, 4800)
PROTOCOLS = tuple(LineProtocol)
# A module that answers Modbus ASCII answers Wisco too (docs/protocol.md section 1: switch 8).
QUICK_PROTOCOLS = (LineProtocol.WISCO, LineProtocol.MODBUS_RTU)
STATIONS = range(LAST_ADDRESS + 1)

_RANGE = re.compile(r"([0-9]{1,2})(?:-([0-9]{1,2}))?")
_TURNAROUND_S = 0.005
# A second module that answers a little later than the first is heard before the next request.
_SILENCE_S = 0.03


@dataclass(frozen=True, slots=True)
class Effort:
    """The effort of a scan.

    Attributes:
        tries: How often a silent station is asked.
        margin_s: The time-out is this much longer than the bytes take.
    """

    tries: int
    margin_s: float


QUICK = Effort(tries=1, margin_s=0.03)
THOROUGH = Effort(tries=4, margin_s=0.06)
# A network delays bytes longer than any adapter.
QUICK_REMOTE = Effort(tries=1, margin_s=0.15)
THOROUGH_REMOTE = Effort(tries=4, margin_s=0.25)


def effort_at(port: str, *, thorough: bool) -> Effort:
    """Return the effort of a scan of a port."""
    if "://" in port:
        return THOROUGH_REMOTE if thorough else QUICK_REMOTE
    return THOROUGH if thorough else QUICK


@dataclass(frozen=True, slots=True)
class ScanSweep:
    """All stations that are asked at one baud rate in one protocol."""

    baud: int
    protocol: LineProtocol
    addresses: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """All requests of a scan: its sweeps, repeated as `effort` says."""

    sweeps: tuple[ScanSweep, ...]
    effort: Effort

    def timing(self, sweep: ScanSweep) -> LineTiming:
        """Return the times of the line during one sweep."""
        rtu = sweep.protocol is LineProtocol.MODBUS_RTU
        return LineTiming(
            baud=sweep.baud,
            turnaround_s=_TURNAROUND_S,
            silence_s=_SILENCE_S,
            end_silence_s=rtu_silence_s(sweep.baud) if rtu else 0.0,
            margin_s=self.effort.margin_s,
        )

    def silent_s(self, sweep: ScanSweep) -> float:
        """Return the time that one absent station takes."""
        # The address changes no length.
        request = prober(sweep.protocol, LAST_ADDRESS).read_inputs
        return self.timing(sweep).timeout_s(len(request.frame), request.reply_chars)

    @property
    def total_s(self) -> float:
        """Return the time if no module answers; a module that answers is quicker."""
        once_s = sum(len(sweep.addresses) * self.silent_s(sweep) for sweep in self.sweeps)
        return once_s * self.effort.tries


def survey_of(
    bauds: Collection[int],
    protocols: Collection[LineProtocol],
    addresses: Collection[int],
    effort: Effort,
) -> ScanPlan:
    """Return the survey of a choice: by baud rate, then protocol, the most probable first."""
    sweeps = tuple(_sweeps(_ordered(BAUDS, bauds), _ordered(PROTOCOLS, protocols), addresses))
    return ScanPlan(sweeps, effort)


def parse_stations(text: str) -> tuple[int, ...]:
    """Return the addresses of a text such as `1-8,12`.

    Raises:
        ValueError: A part of it is wrong; the message says which.
    """
    addresses: list[int] = []
    for part in text.split(","):
        found = _RANGE.fullmatch(part)
        last = int(found[2] or found[1]) if found else -1
        if found is None or last not in STATIONS or int(found[1]) > last:
            raise ValueError(f"{part!r:.40} is no station or range: write 1-8,12")
        addresses += range(int(found[1]), last + 1)
    return tuple(addresses)


def format_stations(addresses: Collection[int]) -> str:
    """Return addresses in the form that `parse_stations` reads."""
    return ",".join(map(str, sorted(addresses)))


def prober(protocol: LineProtocol, address: int) -> Driver:
    """Return the requests to a station of which nothing is known.

    One input read identifies the model: a DO100 refuses it (docs/protocol.md sections 2 and 3).
    """
    return driver_for(protocol, address, DIO100)


def _ordered(order: Sequence[T], chosen: Collection[T]) -> list[T]:
    return [one for one in order if one in chosen]


def _sweeps(
    bauds: Sequence[int], protocols: Sequence[LineProtocol], addresses: Collection[int]
) -> Iterator[ScanSweep]:
    for baud in bauds:
        for protocol in protocols:
            first = 0 if protocol is LineProtocol.WISCO else FIRST_ADDRESS
            asked = tuple(sorted(address for address in addresses if address >= first))
            if asked:
                yield ScanSweep(baud, protocol, asked)
