"""The timing of the plan of a line, computed before anything is sent."""

from collections.abc import Iterator
from dataclasses import dataclass

from bridge.config.schema import GestureConfig, LineConfig
from bridge.drivers import driver_for, settings_driver_for
from bridge.line.plan.bounds import bound_s, cycle_s
from bridge.line.plan.streams import Poll, polls_of, streams_of
from bridge.line.rules.presence import Kind
from bridge.transport.timing import LineTiming


@dataclass(frozen=True, slots=True)
class Forecast:
    """Times in seconds, while every module answers and no command comes.

    Attributes:
        cycle_s: One cycle: everything in the rotation is read once. In addition there is at most
            one read of settings in 2 s.
        inputs_s: By station id: the longest time that an input is not read. A DO100 has none.
        outputs_s: The same for outputs.
        bound_s: The same for all channels of a station.
        exchange_s: The longest exchange of the rotation.
        settings_s: The longest read of modes and hold times; 0: there is none.
    """

    cycle_s: float
    inputs_s: dict[str, float]
    outputs_s: dict[str, float]
    bound_s: dict[str, float]
    exchange_s: float
    settings_s: float


def forecast(line: LineConfig) -> Forecast:
    """Return the times of the plan, from the shortest exchanges (docs/protocol.md section 5)."""
    timing = LineTiming.from_config(line)
    drivers = {s.address: driver_for(line.protocol, s.address, s.model) for s in line.stations}
    settings_s = {
        driver.address: timing.floor_s(
            len(driver.read_settings.frame), driver.read_settings.reply_chars
        )
        for driver in (settings_driver_for(line, config) for config in line.stations)
        if driver is not None
    }
    names = {config.address: config.id for config in line.stations}

    def cost_s(poll: Poll) -> float:
        if poll.kind is Kind.SETTINGS:
            return settings_s[poll.address]
        driver = drivers[poll.address]
        request = driver.read_inputs if poll.kind is Kind.INPUTS else driver.read_outputs
        return timing.floor_s(len(request.frame), request.reply_chars)

    streams = streams_of(line)
    bounds = {poll: bound_s(streams, poll, cost_s) for poll in polls_of(line)}
    inputs_s = {names[p.address]: s for p, s in bounds.items() if p.kind is Kind.INPUTS}
    outputs_s = {names[p.address]: s for p, s in bounds.items() if p.kind is Kind.OUTPUTS}
    return Forecast(
        cycle_s=cycle_s(streams, cost_s),
        inputs_s=inputs_s,
        outputs_s=outputs_s,
        bound_s={name: max(inputs_s.get(name, 0.0), outputs_s[name]) for name in names.values()},
        exchange_s=max(cost_s(poll) for poll in polls_of(line)),
        settings_s=max(settings_s.values(), default=0.0),
    )


def gestures_too_fast(line: LineConfig, plan: Forecast) -> Iterator[str]:
    """Yield one line for each button whose presses may fall between two reads."""
    for config in line.stations:
        for channel in config.inputs:
            if channel.gestures is None:
                continue
            shortest_s = _shortest_s(channel.gestures)
            read_s = plan.inputs_s[config.id]
            if 2 * read_s > shortest_s:
                yield (
                    f"station {config.id}: input {channel.channel} is read every "
                    f"{read_s * 1000:.0f} ms at the latest, too seldom for gestures that are told "
                    f"apart by {shortest_s * 1000:.0f} ms; give the station priority: high, or "
                    "the gestures longer times"
                )


def _shortest_s(config: GestureConfig) -> float:
    return min(config.long_s, config.double_s or config.long_s)
