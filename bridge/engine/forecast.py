"""What the plan of a line will cost, worked out before anything is sent."""

from dataclasses import dataclass

from bridge.config.schema import LineConfig
from bridge.drivers import driver_for
from bridge.engine.plan import Poll, RoundRobin, polls_of
from bridge.engine.presence import Kind
from bridge.transport.timing import LineTiming


@dataclass(frozen=True, slots=True)
class Forecast:
    """Times in seconds, while every module answers and nobody commands anything.

    Attributes:
        cycle_s: One round: inputs and outputs of every station once.
        bound_s: By station id: no channel is left unread for longer.
    """

    cycle_s: float
    bound_s: dict[str, float]


def forecast(line: LineConfig) -> Forecast:
    """The floor of each exchange (PROTOCOL.md section 5), put together as the plan does it."""
    timing = LineTiming.from_config(line)
    drivers = {s.address: driver_for(line.protocol, s.address, s.model) for s in line.stations}

    def cost_s(poll: Poll) -> float:
        driver = drivers[poll.station]
        request = driver.read_inputs if poll.kind is Kind.INPUTS else driver.read_outputs
        return timing.floor_s(len(request.frame), request.reply_chars)

    polls = polls_of(line)
    plan = RoundRobin(polls, {})
    return Forecast(
        cycle_s=sum(cost_s(poll) for poll in polls),
        bound_s={s.id: plan.bound_s(s.address, cost_s) for s in line.stations},
    )
