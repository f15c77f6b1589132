"""The reads of a line: in the rotation, in the sweep, or once a minute.

Inputs change by themselves. Outputs change by our writes, which are read back at once; by pulses
that end, at a known time; and by another master, which is rare. Modes and hold times change by a
tool at the module.
"""

from dataclasses import dataclass

from bridge.config.schema import LineConfig
from bridge.line.rules.presence import Kind

SETTINGS_S = 60.0  # docs/contract.md, promise 1: a changed mode is known after this time


@dataclass(frozen=True, slots=True)
class Poll:
    """One read of one station."""

    address: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Streams:
    """Every poll of a line once.

    Attributes:
        normal: In the rotation.
        high: In the rotation, more often.
        swept: Each is read at least once in `sweep_s`.
        sweep_s: The time of a sweep.
        settings: Each is read at least once in `SETTINGS_S`, if the module takes Modbus frames.
    """

    normal: tuple[Poll, ...]
    high: tuple[Poll, ...]
    swept: tuple[Poll, ...]
    sweep_s: float
    settings: tuple[Poll, ...] = ()

    @property
    def steady(self) -> tuple[Poll, ...]:
        """Return all reads of the rotation."""
        return self.high + self.normal


def polls_of(line: LineConfig) -> tuple[Poll, ...]:
    """Return reads of inputs and outputs of every station, in the order of the file."""
    polls = []
    for config in line.stations:
        if config.model.inputs:
            polls.append(Poll(config.address, Kind.INPUTS))
        polls.append(Poll(config.address, Kind.OUTPUTS))
    return tuple(polls)


def streams_of(line: LineConfig) -> Streams:
    """Return the streams of a line; without a sweep everything is in the rotation."""
    polls = polls_of(line)
    high_stations = {config.address for config in line.stations if config.high_priority}
    steady = set(polls)
    if line.output_sweep_s > 0 and any(poll.kind is Kind.INPUTS for poll in polls):
        steady = {poll for poll in polls if poll.kind is Kind.INPUTS}
        with_inputs = {poll.address for poll in steady}
        # A DO100 of high priority has no inputs, so its outputs are read often.
        steady |= {Poll(s, Kind.OUTPUTS) for s in high_stations - with_inputs}
    return Streams(
        normal=tuple(p for p in polls if p in steady and p.address not in high_stations),
        high=tuple(p for p in polls if p in steady and p.address in high_stations),
        swept=tuple(p for p in polls if p not in steady),
        sweep_s=line.output_sweep_s,
        settings=tuple(
            Poll(config.address, Kind.SETTINGS)
            for config in line.stations
            if line.asks_modbus(config)
        ),
    )
