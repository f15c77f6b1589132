"""A plan and the presences that it looks at, run on a virtual clock with what exchanges cost."""

from collections.abc import Callable
from dataclasses import dataclass, field

from bridge.config.schema import LineConfig, StationConfig
from bridge.line.plan.plan import Idle, WirePlan
from bridge.line.plan.streams import Poll, streams_of
from bridge.line.rules.presence import Kind, Presence, fallen_silent
from bridge.model import LineProtocol, ModuleType

# docs/protocol.md section 5: characters of a read of 16 channels, request and reply.
_CHARS = {LineProtocol.WISCO: 16, LineProtocol.MODBUS_RTU: 22, LineProtocol.MODBUS_ASCII: 32}
_TURNAROUND_S = 0.005
_LATE_WINDOW_S = 0.3
_CONTACT_EXCHANGES = 6


@dataclass(frozen=True, slots=True)
class Costs:
    """The time of one exchange on the line, in seconds."""

    good_s: float
    silent_s: float
    late_window_s: float

    @classmethod
    def of(cls, protocol: LineProtocol, baud: int) -> "Costs":
        """Return the times as the bus has them: a time-out, and after it a late window (Wisco)."""
        good_s = _CHARS[protocol] * 10 / baud + _TURNAROUND_S
        late_s = _LATE_WINDOW_S if protocol is LineProtocol.WISCO else 0.0
        return cls(good_s, good_s + 0.1, late_s)


def line_of(model: ModuleType, count: int, output_sweep_s: float = 2.0) -> LineConfig:
    """A line of `count` equal modules, stations 0 to count - 1."""
    stations = tuple(
        StationConfig(address, model, f"s{address}", f"s{address}", (), ())
        for address in range(count)
    )
    return LineConfig(
        "main",
        "/dev/null",
        9600,
        LineProtocol.WISCO,
        stations,
        output_sweep_s=output_sweep_s,
    )


@dataclass(slots=True)
class VirtualPlan:
    """Does what the plan says. `answers(station, now)` tells whether a read is answered.

    Attributes:
        reads: When each poll was answered.
        asked: Every poll with its instant and whether it was answered.
        flips: Instants at which a station went offline.
    """

    line: LineConfig
    costs: Costs
    answers: Callable[[int, float], bool]
    now: float = 0.0
    quiet_until: float = 0.0
    reads: dict[Poll, list[float]] = field(default_factory=dict)
    asked: list[tuple[float, Poll, bool]] = field(default_factory=list)
    flips: dict[int, list[float]] = field(default_factory=dict)
    presences: dict[int, Presence] = field(init=False)
    plan: WirePlan = field(init=False)

    def __post_init__(self) -> None:
        self.presences = {config.address: Presence() for config in self.line.stations}
        self.plan = WirePlan(streams_of(self.line), self.presences)

    def run_until(self, end: float) -> None:
        """Works until that instant."""
        while self.now < end:
            self.step()

    def step(self) -> None:
        """One exchange, or a sleep until the next is due."""
        due = self.plan.next(self.now)
        if isinstance(due, Idle):
            self.now = max(self.now, due.until)
            return
        self.now = max(self.now, self.quiet_until)
        begun = self.now
        answered = self.answers(due.address, self.now)
        exchanges = _CONTACT_EXCHANGES if due.kind is Kind.CONTACT and answered else 1
        self.now += self.costs.good_s * exchanges if answered else self.costs.silent_s
        if not answered:
            self.quiet_until = self.now + self.costs.late_window_s
        self.asked.append((begun, due, answered))
        presence = self.presences[due.address]
        if due.kind is Kind.CONTACT:
            if answered:
                presence.arrived(self.now)
            else:
                presence.absent(self.now)
                free_at = max(self.now, self.quiet_until)
                self.plan.probed_in_vain(free_at - begun, free_at)
            return
        if answered:
            presence.answered(self.now)
            self.reads.setdefault(due, []).append(self.now)
            return
        presence.missed(due.kind, self.now)
        for address in fallen_silent(self.presences, self.now):
            self.presences[address].gone(self.now)
            self.flips.setdefault(address, []).append(self.now)

    def all_online(self) -> bool:
        """Return whether every station is online."""
        return all(presence.online for presence in self.presences.values())

    def longest_gap_s(self, address: int, since: float, until: float) -> float:
        """The longest time between two reads of one channel of a station."""
        gaps = [
            later - earlier
            for poll, times in self.reads.items()
            if poll.address == address and poll.kind is not Kind.SETTINGS
            for earlier, later in zip(
                [since, *[t for t in times if since < t < until]],
                [*[t for t in times if since < t < until], until],
                strict=True,
            )
        ]
        return max(gaps)
