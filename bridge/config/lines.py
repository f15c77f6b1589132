"""The section `lines`: every line with its stations."""

import posixpath
from collections.abc import Iterable
from dataclasses import dataclass, field

from bridge.config.durations import auto_or, duration
from bridge.config.endpoints import line_port
from bridge.config.names import folded, identifier
from bridge.config.nodes import Place, Reader, WrongValueError, items
from bridge.config.scalars import choice, one_of
from bridge.config.schema import LONGEST_LEARNED_S, LineConfig, StationConfig
from bridge.config.stations import LineFacts, read_station
from bridge.config.tables import Table, Unique, table_of
from bridge.model import BAUD_RATES, LAST_ADDRESS, USUAL_BAUD, LineProtocol, Writes

# docs/protocol.md section 1: up to 32 modules on one line.
MAX_STATIONS = LAST_ADDRESS + 1

# A thread without a sign of life for 25 s counts as stuck (docs/contract.md, promise 10). A line
# gives one between two exchanges, so one exchange has to be much shorter.
LONGEST_EXCHANGE_S = 20.0
_LONGEST_FRAMES_S = 3.0  # `timeout: auto`: the longest request and reply at 4800 baud

_PROTOCOLS = {protocol.value: protocol for protocol in LineProtocol}
_WRITES = {writes.value: writes for writes in Writes}
_DEFAULT = LineConfig("", "", USUAL_BAUD, LineProtocol.WISCO, stations=())


@dataclass(frozen=True, slots=True)
class _Used:
    """The values that no two lines of a file may share."""

    line_ids: Unique = field(default_factory=Unique)
    ports: Unique = field(default_factory=Unique)
    station_ids: Unique = field(default_factory=Unique)


def read_lines(place: Place) -> tuple[LineConfig, ...]:
    """Read all lines. A wrong line is left out of the result, and has a problem."""
    if not items(place):
        raise WrongValueError("has no line; write at least one, with id, port and stations")
    return any_lines(place)


def any_lines(place: Place) -> tuple[LineConfig, ...]:
    """Read the lines, which may be none."""
    used = _Used()
    read = (line.read(lambda place: _read_line(place, used), None) for line in items(place))
    return tuple(line for line in read if line is not None)


def _read_line(place: Place, used: _Used) -> LineConfig | None:
    with table_of(place) as table:
        line_id = _read_id(table, used)
        port = _read_port(table, used)
        baud = table.need("baud", one_of(BAUD_RATES), _one_of_words(BAUD_RATES))
        protocol = table.need("protocol", choice(_PROTOCOLS), _one_of_words(_PROTOCOLS))
        writes = _read_writes(table, protocol)
        turnaround_s = table.get(
            "turnaround", auto_or(duration("0ms", "10s")), _DEFAULT.turnaround_s
        )
        timeout_s = table.get("timeout", auto_or(duration("1ms", "60s")), _DEFAULT.timeout_s)
        silence_s = table.get("silence", auto_or(duration("0ms", "10s")), _DEFAULT.silence_s)
        late_window_s = table.get(
            "late_window", auto_or(duration("0ms", "60s")), _DEFAULT.late_window_s
        )
        _check_timings(table, turnaround_s, timeout_s, silence_s, late_window_s)
        output_sweep_s = table.get("output_sweep", duration("0ms", "60s"), _DEFAULT.output_sweep_s)
        # If the protocol itself is wrong, station 0 is not reported as well.
        wisco_only = protocol in {None, LineProtocol.WISCO} and writes is not Writes.MODBUS
        facts = LineFacts(line_id, wisco_only, Unique(), used.station_ids)
        stations = table.need("stations", _stations_of(facts), "write at least one")
    if line_id is None or port is None or baud is None or protocol is None or stations is None:
        return None
    return LineConfig(
        id=line_id,
        port=port,
        baud=baud,
        protocol=protocol,
        stations=stations,
        writes=writes,
        turnaround_s=_DEFAULT.turnaround_s if turnaround_s is None else turnaround_s,
        timeout_s=timeout_s,
        silence_s=silence_s,
        late_window_s=_DEFAULT.late_window_s if late_window_s is None else late_window_s,
        turnaround_auto=turnaround_s is None,
        late_window_auto=late_window_s is None,
        output_sweep_s=output_sweep_s,
    )


def _check_timings(
    table: Table,
    turnaround_s: float | None,
    timeout_s: float | None,
    silence_s: float | None,
    late_window_s: float | None,
) -> None:
    computed_s = _or_learned(turnaround_s) + _LONGEST_FRAMES_S
    waits = {
        "silence": silence_s or 0.0,
        "turnaround": computed_s if timeout_s is None else 0.0,
        "timeout": timeout_s or 0.0,
        "late_window": _or_learned(late_window_s),
    }
    longest_s = sum(waits.values())
    if longest_s > LONGEST_EXCHANGE_S:
        table.problem(
            max(waits, key=waits.__getitem__),
            f"silence, timeout and late_window come to {longest_s:g} s; write "
            f"{LONGEST_EXCHANGE_S:g} s at most for all of them, or the line would count as stuck",
        )


def _or_learned(seconds: float | None) -> float:
    return LONGEST_LEARNED_S if seconds is None else seconds


def _read_id(table: Table, used: _Used) -> str | None:
    line_id = table.need("id", identifier, "write a short name for topics, such as main")
    if line_id is not None:
        used.line_ids.claim(folded(line_id), table.place("id"), f"id {line_id}")
    return line_id


def _read_port(table: Table, used: _Used) -> str | None:
    port = table.need("port", line_port, "write a device such as /dev/ttyUSB0, or tcp://host:port")
    if port is not None:
        # Links are not followed: their target changes as adapters come and go.
        same = posixpath.normpath(port) if port.startswith("/") else port.lower()
        used.ports.claim(same, table.place("port"), f"port {table.place('port').shown}")
    return port


def _read_writes(table: Table, protocol: LineProtocol | None) -> Writes:
    writes = table.get("writes", choice(_WRITES), _DEFAULT.writes)
    if writes is not Writes.AUTO and protocol not in {None, LineProtocol.WISCO}:
        table.problem("writes", f"{writes} goes only with protocol: wisco; take the key out")
    return writes


def _stations_of(facts: LineFacts) -> Reader[tuple[StationConfig, ...]]:
    def read(place: Place) -> tuple[StationConfig, ...]:
        listed = items(place)
        if not listed:
            raise WrongValueError("has no station; write at least one, with address and model")
        if len(listed) > MAX_STATIONS:
            listed[MAX_STATIONS].problem(
                f"a line carries {MAX_STATIONS} stations at most; move this one to another line"
            )
        places = listed[:MAX_STATIONS]
        read = (station.read(lambda place: read_station(place, facts), None) for station in places)
        return tuple(config for config in read if config is not None)

    return read


def _one_of_words(options: Iterable[object]) -> str:
    return f"write one of {', '.join(map(str, options))}"
