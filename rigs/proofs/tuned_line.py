"""A Wisco line that is slow or late, read round after round with settings that are tried out."""

import itertools
from dataclasses import dataclass, replace

from support.virtual_panel import VirtualPanel

from bridge.config.durations import parse_duration
from bridge.config.schema import LineConfig
from bridge.errors import ExchangeError
from bridge.model import DIO100, LineProtocol
from bridge.protocol.wisco import ReadOutputsHex
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule
from bridge.transport.bus import bus_of
from proofs.verified_line import verified

BAUD = 9600
STATIONS = 4
TIMEOUTS_S = (None, 0.06, 0.12, 0.16, 0.2, 0.28, 0.36, 0.44)
WINDOWS_S = (0.0, 0.1, 0.2, 0.3)
LEARNS = 300
_LINE = LineConfig("line", "virtual", BAUD, LineProtocol.WISCO, ())


@dataclass(frozen=True, slots=True)
class Rounds:
    """How long one round took, and how many replies were taken for another station's."""

    cycle_s: float
    to_another: int


def measured(turnaround_s: float, late: tuple[float, float], rounds: int) -> Rounds:
    """What the settings do that verify proposes."""
    seen = verified(
        LineProtocol.WISCO,
        (DIO100,) * STATIONS,
        samples=200,
        turnaround_s=turnaround_s,
        late=late,
        baud=BAUD,
    )
    values = {
        one["name"]: None if one["value"] == "auto" else float(parse_duration(one["value"]))
        for one in seen.document["settings"]
    }
    line = replace(
        _LINE,
        turnaround_s=values["turnaround"] or 0.0,
        timeout_s=values["timeout"],
        silence_s=values["silence"],
        late_window_s=values["late_window"] or 0.0,
    )
    return _read(line, turnaround_s, late, rounds)


def learned(turnaround_s: float, late: tuple[float, float], rounds: int) -> Rounds:
    """What a line does that learns its times; so many rounds are not counted."""
    line = replace(_LINE, turnaround_auto=True, late_window_auto=True)
    return _read(line, turnaround_s, late, rounds, learns=LEARNS)


def best_fixed(turnaround_s: float, late: tuple[float, float], rounds: int) -> float:
    """The shortest cycle of all fixed settings that give no reply to another station."""
    tried = (
        _read(
            replace(_LINE, timeout_s=timeout_s, late_window_s=window_s), turnaround_s, late, rounds
        )
        for timeout_s, window_s in itertools.product(TIMEOUTS_S, WINDOWS_S)
    )
    return min(one.cycle_s for one in tried if not one.to_another)


def _read(
    line: LineConfig, turnaround_s: float, late: tuple[float, float], rounds: int, learns: int = 0
) -> Rounds:
    modules = [SimulatedModule(DIO100, at) for at in range(1, STATIONS + 1)]
    for module in modules:
        module.set_output(module.address, True)
    panel = VirtualPanel(LineProtocol.WISCO, BAUD, modules, turnaround_s=turnaround_s, seed=7)
    if late[0]:
        panel.faults.set(FaultKind.LATE, probability=late[0], delay_s=late[1])
    bus = bus_of(line, panel.open(BAUD), panel.time.clock, panel.time.sleep)
    requests = [ReadOutputsHex(module.address, DIO100) for module in modules]
    began, read, to_another = panel.time.now, 0, 0
    for turn, request in enumerate(requests * (learns + rounds)):
        if turn == learns * len(requests):
            began, read = panel.time.now, 0
        try:
            value = bus.exchange(request, protected=False)
        except ExchangeError:
            continue
        read += 1
        to_another += value != 1 << (request.address - 1)
    if not read:
        return Rounds(float("inf"), 0)
    return Rounds((panel.time.now - began) * STATIONS / read, to_another)
