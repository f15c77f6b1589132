"""Every command that was sent, what became of it, and every relay that was switched: compared.

No I/O and no threads here. Instants are monotonic seconds.
"""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from bridge.simulator.module import Switching

# A command ends within its deadline of 2 s, the 3 s of the link check, and the exchanges that it
# takes. Its verdict waits for a broker that is away for 60 s at most.
LONGEST_TO_WIRE_S = 10.0
FORGET_AFTER_S = 120.0
# What was on its way when the link went may be lost with it: sent so long before.
ON_ITS_WAY_S = 3.0


@dataclass(slots=True)
class Order:
    """One command.

    Attributes:
        wanted: What it may do: outputs and their values; None: either.
        answer: Its verdict's payload, as it came first.
    """

    station: str
    wanted: dict[int, bool | None]
    sent_at: float
    answered_at: float | None = None
    answer: bytes = b""
    status: str = ""
    used: bool = False

    def explains(self, station: str, switching: Switching) -> bool:
        """Whether it can be what switched a relay."""
        if station != self.station or switching.output not in self.wanted:
            return False
        if self.status == "refused":  # it was never sent
            return False
        until = self.answered_at or self.sent_at + LONGEST_TO_WIRE_S
        value = self.wanted[switching.output]
        return self.sent_at <= switching.at <= until and value in {None, switching.value}


class Link:
    """When the way from us to the bridge was whole: the bridge's own pings tell."""

    def __init__(self) -> None:
        self._broken_since: float | None = None
        self._mended_at: float | None = None
        self._spans: deque[tuple[float, float]] = deque(maxlen=200)

    @property
    def whole(self) -> bool:
        """Whether nothing is known to be wrong."""
        return self._broken_since is None

    def broken(self, now: float) -> None:
        """Something is done to the link."""
        self._broken_since = self._broken_since or now
        self._mended_at = None

    def mended(self, now: float) -> None:
        """It is undone: the next ping but one says that the bridge is there again."""
        self._mended_at = now

    def ping(self, now: float) -> None:
        """A ping of the bridge passed."""
        if self._broken_since and self._mended_at and now > self._mended_at + 1.0:
            self._spans.append((self._broken_since - ON_ITS_WAY_S, now + 1.0))
            self._broken_since = self._mended_at = None

    def disturbed(self, at: float) -> bool:
        """Whether what was sent at that instant may not have arrived."""
        if self._broken_since is not None and at >= self._broken_since - ON_ITS_WAY_S:
            return True
        return any(begin <= at <= end for begin, end in self._spans)


@dataclass(slots=True)
class Tally:
    """What the ledger came to.

    Attributes:
        verdicts: By status, and reason where there is one.
        told_again: The same verdict twice, around a cut: QoS 1 allows that.
        lost: No verdict, but the link was cut about then: it may never have arrived.
        missing: No verdict without that excuse.
        contradicted: A second verdict that differs, or came without a cut.
        wrong: Relays that nobody's command explains.
        twice: Pulses beyond one for a command.
        not_sent: Pulses called done that no relay saw.
        longest_s: The longest time to a verdict, while the link was whole.
    """

    sent: int = 0
    answered: int = 0
    switched: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    told_again: int = 0
    lost: int = 0
    missing: int = 0
    contradicted: int = 0
    wrong: int = 0
    twice: int = 0
    not_sent: int = 0
    longest_s: float = 0.0
    examples: list[str] = field(default_factory=list)

    def example(self, text: str) -> None:
        """Keeps the first few things that were wrong."""
        if len(self.examples) < 20:
            self.examples.append(text)


class Ledger:
    """Commands by number, until they are old."""

    def __init__(self, pulses: frozenset[int]) -> None:
        self.link = Link()
        self.tally = Tally()
        self._pulses = pulses
        self._orders: dict[int, Order] = {}
        self._next = 0

    def sent(self, station: str, wanted: dict[int, bool | None], now: float) -> int:
        """Takes down a command; returns its number."""
        self._next += 1
        self._orders[self._next] = Order(station, wanted, now)
        self.tally.sent += 1
        return self._next

    @property
    def waiting(self) -> int:
        """How many commands have no verdict, and may have one yet."""
        return sum(
            order.answered_at is None and not self.link.disturbed(order.sent_at)
            for order in self._orders.values()
        )

    def answered(self, number: int, payload: bytes, verdict: dict[str, Any], now: float) -> None:
        """Takes down a verdict."""
        order = self._orders.get(number)
        if order is None or order.answered_at is not None:
            self._again(number, order, payload)
            return
        order.answered_at, order.answer, order.status = now, payload, verdict["status"]
        self.tally.answered += 1
        self.tally.verdicts["/".join(filter(None, (order.status, verdict.get("reason"))))] += 1
        if not self.link.disturbed(order.sent_at):
            self.tally.longest_s = max(self.tally.longest_s, now - order.sent_at)

    def _again(self, number: int, order: Order | None, payload: bytes) -> None:
        redelivered = order is not None and order.answer == payload
        if redelivered and order is not None and self.link.disturbed(order.answered_at or 0.0):
            self.tally.told_again += 1
        else:
            self.tally.contradicted += 1
            self.tally.example(f"a second verdict on {number}: {payload!r}")

    def judge(
        self,
        switchings: Iterable[tuple[str, Switching]],
        now: float,
        old_s: float = FORGET_AFTER_S,
    ) -> None:
        """Compares what relays did with what was asked, then closes the books on what is old.

        To be called while no command is on its way.
        """
        for station, switching in switchings:
            if switching.frame:  # else a pulse's end, or a hand
                self._judge_one(station, switching)
        for number, order in list(self._orders.items()):
            if now - order.sent_at >= old_s:
                self._close(number, order)
                del self._orders[number]

    def _judge_one(self, station: str, switching: Switching) -> None:
        self.tally.switched += 1
        pulse = switching.output in self._pulses and switching.value
        reasons = [o for o in self._orders.values() if o.explains(station, switching)]
        # A range of outputs is written with its gaps as they were: that switches nothing.
        if not reasons and (switching.changed or pulse):
            self.tally.wrong += 1
            self.tally.example(f"{station} switched without a command: {switching}")
        elif pulse:
            fresh = min((o for o in reasons if not o.used), key=_urgency, default=None)
            if fresh is None:
                self.tally.twice += 1
                self.tally.example(f"{station} pulsed more often than asked: {switching}")
            else:
                fresh.used = True

    def _close(self, number: int, order: Order) -> None:
        if order.answered_at is None and self.link.disturbed(order.sent_at):
            self.tally.lost += 1
        elif order.answered_at is None:
            self.tally.missing += 1
            self.tally.example(f"no verdict on {number}: {order}")
        elif order.status == "done" and not order.used and self._pulses & order.wanted.keys():
            self.tally.not_sent += 1
            self.tally.example(f"a pulse was called done that nobody saw, {number}: {order}")


def _urgency(order: Order) -> tuple[bool, float]:
    """Of several commands that a pulse may belong to: one called done needs it, the oldest first.

    One that is `unknown` or `failed` may never have reached the module.
    """
    return order.status != "done", order.answered_at or order.sent_at + LONGEST_TO_WIRE_S
