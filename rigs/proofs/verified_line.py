"""Simulated modules behind a port in virtual time, and what verify says of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from support.virtual_panel import VirtualPanel

from bridge.commission.verify.line import OwnLine
from bridge.commission.verify.verification import Module, Verification, patient
from bridge.config.schema import LineConfig
from bridge.model import DO100, LineProtocol, ModuleType
from bridge.simulator.dialect import READINGS, Dialect
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule

BAUD = 19200
PULSE_OUTPUT = 2
_TEXT = {
    Dialect.ERR_BARE,
    Dialect.CRLF,
    Dialect.LOWER_HEX,
    Dialect.REE_SUM_ALL,
}
_MEASURED = {
    Dialect.OFF_IGNORED,
    Dialect.LONG_HOLD,
    Dialect.NEEDS_SILENCE,
    Dialect.SLOW,
    Dialect.VERY_SLOW,
    Dialect.LATE,
    Dialect.ODD_CODES,
}


@dataclass(frozen=True, slots=True)
class Verified:
    """What came of one verification."""

    panel: VirtualPanel
    document: Mapping[str, Any]

    @property
    def words(self) -> dict[str, str]:
        """The word of each assumption, of the only module."""
        return {one["id"]: str(one["word"]) for one in self.document["stations"][0]["findings"]}


class _Clock:
    """The clock of a panel that is made after its modules."""

    panel: VirtualPanel | None = None

    def __call__(self) -> float:
        """The time."""
        return self.panel.time.now if self.panel else 1000.0


def verified(
    protocol: LineProtocol,
    models: tuple[ModuleType, ...],
    dialect: Dialect | None = None,
    *,
    seed: int = 1,
    lost: float = 0.0,
    samples: int = 60,
    output: int | None = None,
    turnaround_s: float = 0.002,
    late: tuple[float, float] = (0.0, 0.0),
    baud: int = BAUD,
) -> Verified:
    """Verifies modules at stations 1 on; `late` is a probability and a delay in seconds."""
    clock = _Clock()
    modules = [SimulatedModule(model, at, clock=clock) for at, model in enumerate(models, 1)]
    dialects = () if dialect is None else (dialect,)
    panel = clock.panel = VirtualPanel(
        protocol, baud, modules, turnaround_s=turnaround_s, seed=seed, dialects=dialects
    )
    if output is not None:
        modules[0].set_mode(output, pulse=True, hold_s=1.0)
    if lost:
        panel.faults.set(FaultKind.SILENT, probability=lost)
    if late[0]:
        panel.faults.set(FaultKind.LATE, probability=late[0], delay_s=late[1])
    config = LineConfig("line", "virtual", baud, protocol, ())
    asked = [Module(at, model, f"s{at}") for at, model in enumerate(models, 1)]
    line = OwnLine(panel.open(baud), patient(config), panel.time.clock, panel.time.sleep)
    work = Verification(config, asked, samples, output)
    return Verified(panel, work.run(line, lambda _: None))


def differing(dialect: Dialect | None, protocol: LineProtocol, model: ModuleType) -> set[str]:
    """Which assumptions such a module does not follow, as far as it can be seen."""
    if dialect is None:
        return set()
    text, due = protocol is not LineProtocol.MODBUS_RTU, {READINGS[dialect]}
    if dialect is Dialect.ODD_CODES and model is DO100:
        return due | {"fc02-on-do100"}
    if dialect in _MEASURED or (dialect in _TEXT and text):
        return due
    if dialect in {Dialect.NO_HEX_READS, Dialect.WISCO_ONLY} and protocol is LineProtocol.WISCO:
        return due
    if dialect is Dialect.DO100_INPUTS and model is DO100:
        return due
    return set()
