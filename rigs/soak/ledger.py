"""Every command that was sent, what became of it, and every relay that was switched: compared.

No I/O and no threads here. Instants are monotonic seconds.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from bridge.simulator.module import Switching
from soak.disturbances import Disturbances
from soak.link import Link
from soak.relays import BLUR_S, Move, Relays, Rules

# A command goes out within its deadline and the 3 s of the link check (docs/contract.md, promise
# 2). Its verdict waits for a broker that is away for 60 s at most.
DEADLINE_S = 2.0
LINK_CHECK_S = 3.0
FORGET_AFTER_S = 120.0


@dataclass(slots=True)
class Order:
    """One command.

    Attributes:
        wanted: What it may do: outputs and their values; None: either.
        until: Later nothing of it may go out.
        patience_s: What it allows besides the usual deadline.
        answer: Its verdict's payload, as it came first.
        slept: The machine was suspended while it was on its way.
    """

    station_id: str
    wanted: dict[int, bool | None]
    sent_at: float
    until: float
    patience_s: float = 0.0
    answered_at: float | None = None
    answer: bytes = b""
    status: str = ""
    used: bool = False
    slept: bool = False

    def explains(self, station_id: str, switching: Switching) -> bool:
        """Return whether it can be what switched a relay, in time or late."""
        if station_id != self.station_id or switching.output not in self.wanted:
            return False
        if self.status == "refused":  # it was never sent
            return False
        value = self.wanted[switching.output]
        if value not in {None, switching.value}:
            return False
        return self.sent_at <= switching.at <= (self.answered_at or switching.at)


@dataclass(slots=True)
class Tally:
    """What the ledger came to.

    Attributes:
        verdicts: By status, and reason where there is one.
        told_again: The same verdict twice, around a cut: QoS 1 allows that.
        lost: No verdict, but the link was cut about then: it may never have arrived.
        missing: No verdict without that excuse.
        contradicted: A second verdict that differs, or came without a cut.
        own: What rules of the configuration switched, by their key.
        wrong: Relays that no command and no rule explains.
        late: Relays that a command switched after its time.
        raced: What a hand switched right between the read and the write of a range.
        twice: Pulses beyond one for a command.
        not_sent: Pulses called done that no relay saw.
        harms: What else never may be, by its name.
        longest_s: The longest time to a verdict, while the link was whole; what a command allowed
            besides the usual 2 s is taken off.
    """

    sent: int = 0
    answered: int = 0
    switched: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    told_again: int = 0
    lost: int = 0
    missing: int = 0
    contradicted: int = 0
    own: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    late: int = 0
    raced: int = 0
    twice: int = 0
    not_sent: int = 0
    harms: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0
    examples: list[str] = field(default_factory=list)

    def example(self, text: str) -> None:
        """Keeps the first few things that were wrong."""
        if len(self.examples) < 40:
            self.examples.append(text)

    def harm(self, name: str, text: str) -> None:
        """Counts something that never may be."""
        self.harms[name] += 1
        self.example(f"{name}: {text}")


class Ledger:
    """Commands by number, until they are old."""

    def __init__(self, rules: Rules) -> None:
        self.link = Link()
        self.tally = Tally()
        self.disturbances = Disturbances()
        self.relays = Relays(rules, self.disturbances, self.tally.harm)
        self._pulses = rules.pulses
        self._orders: dict[int, Order] = {}
        self._next = 0

    def sent(
        self,
        station_id: str,
        wanted: dict[int, bool | None],
        now: float,
        deadline_s: float = DEADLINE_S,
    ) -> int:
        """Takes down a command; returns its number."""
        self._next += 1
        patience_s = max(0.0, deadline_s - DEADLINE_S)
        until = now + deadline_s + LINK_CHECK_S + BLUR_S
        self._orders[self._next] = Order(station_id, wanted, now, until, patience_s)
        self.tally.sent += 1
        return self._next

    def woke(self, now: float, slept_s: float) -> None:
        """The machine was suspended, and what was on its way is older by that time."""
        self.link.suspended(now, slept_s)
        for order in self._orders.values():
            if order.answered_at is None:
                order.slept = True
                order.until = min(order.until, max(order.until - slept_s, now + BLUR_S))

    @property
    def waiting(self) -> int:
        """Return how many commands have no verdict and may still get one."""
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
        if not self.link.disturbed(order.sent_at) and not order.slept:
            took_s = now - order.sent_at - order.patience_s
            self.tally.longest_s = max(self.tally.longest_s, took_s)

    def _again(self, number: int, order: Order | None, payload: bytes) -> None:
        redelivered = order is not None and order.answer == payload
        if redelivered and order is not None and self.link.disturbed(order.answered_at or 0.0):
            self.tally.told_again += 1
        else:
            self.tally.contradicted += 1
            self.tally.example(f"a second verdict on {number}: {payload!r}")

    def judge(
        self,
        moves: Iterable[Move],
        now: float,
        old_s: float = FORGET_AFTER_S,
    ) -> None:
        """Compares what relays did with what was asked, then closes the books on what is old.

        To be called while no command is on its way.
        """
        for move in moves:
            if move.switching.frame:  # else a pulse's end, or a hand
                self._judge_one(move)
            self.relays.take(move)
        self.relays.look(now)
        for number, order in list(self._orders.items()):
            if now - order.sent_at >= old_s:
                self._close(number, order)
                del self._orders[number]

    def _judge_one(self, move: Move) -> None:
        station_id, switching = move.station_id, move.switching
        self.tally.switched += 1
        pulse = switching.value and (move.pulse or switching.output in self._pulses)
        able = [o for o in self._orders.values() if o.explains(station_id, switching)]
        reasons = [o for o in able if switching.at <= o.until]
        # A range of outputs is written with its gaps as they were: that switches nothing.
        if not reasons and (switching.changed or pulse):
            self._unasked(move, able)
        elif pulse:
            fresh = min((o for o in reasons if not o.used), key=_urgency, default=None)
            if fresh is None:
                self.tally.twice += 1
                self.tally.example(f"{station_id} pulsed more often than asked: {switching}")
            else:
                fresh.used = True

    def _unasked(self, move: Move, able: list[Order]) -> None:
        if rule := self.relays.rule(move, *self.link.heard_before(move.switching.at)):
            self.tally.own[rule] += 1
        elif able:
            self.tally.late += 1
            self.tally.example(f"{move.station_id} switched late: {move.switching} by {able[-1]}")
        elif self.relays.hand_before(move):
            self.tally.raced += 1
        else:
            self.tally.wrong += 1
            self.tally.example(f"{move.station_id} switched without a command: {move.switching}")

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
    return order.status != "done", order.answered_at or order.until
