"""What of a line is read all the time, what is only swept, and what once a minute.

Inputs change by themselves. Outputs change by our writes, which are read back at once, by pulses
that end, which is known beforehand, and by another master, which is rare. Modes and hold times
change by a tool at the module itself.
"""

from dataclasses import dataclass

from bridge.config.schema import LineConfig
from bridge.line.rules.presence import Kind

SETTINGS_S = 60.0  # docs/contract.md, promise 1: a mode that was changed meanwhile is known by then


@dataclass(frozen=True, slots=True)
class Poll:
    """One read of one station: the plan's word to the line worker."""

    station: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Streams:
    """Every poll of a line once.

    Attributes:
        normal: Read all the time, by turns.
        high: Read all the time, and more often.
        swept: Each read at least once in `sweep_s`.
        sweep_s: How long a sweep may take.
        settings: Each read at least once in `SETTINGS_S`, where the module takes Modbus frames.
    """

    normal: tuple[Poll, ...]
    high: tuple[Poll, ...]
    swept: tuple[Poll, ...]
    sweep_s: float
    settings: tuple[Poll, ...] = ()

    @property
    def steady(self) -> tuple[Poll, ...]:
        """Return what is read all the time."""
        return self.high + self.normal


def polls_of(line: LineConfig) -> tuple[Poll, ...]:
    """Inputs and outputs of every station of a line, in the file's order."""
    polls = []
    for station in line.stations:
        if station.model.inputs:
            polls.append(Poll(station.address, Kind.INPUTS))
        polls.append(Poll(station.address, Kind.OUTPUTS))
    return tuple(polls)


def streams_of(line: LineConfig) -> Streams:
    """Return where nothing is swept, everything is read by turns."""
    polls = polls_of(line)
    high_stations = {station.address for station in line.stations if station.high_priority}
    steady = set(polls)
    if line.output_sweep_s > 0 and any(poll.kind is Kind.INPUTS for poll in polls):
        steady = {poll for poll in polls if poll.kind is Kind.INPUTS}
        with_inputs = {poll.station for poll in steady}
        # A DO100 of high priority has nothing else to be read often.
        steady |= {Poll(s, Kind.OUTPUTS) for s in high_stations - with_inputs}
    return Streams(
        normal=tuple(p for p in polls if p in steady and p.station not in high_stations),
        high=tuple(p for p in polls if p in steady and p.station in high_stations),
        swept=tuple(p for p in polls if p not in steady),
        sweep_s=line.output_sweep_s,
        settings=tuple(
            Poll(station.address, Kind.SETTINGS)
            for station in line.stations
            if line.asks_modbus(station)
        ),
    )
