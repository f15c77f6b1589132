"""Asks the broker for subscriptions, one packet at a time, with as many filters as it accepts."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from bridge.mqtt.events import Subscription
from bridge.mqtt.refusals import Answer

Refused = Mapping[str, Answer]  # by filter


@dataclass(slots=True)
class _Group:
    """The filters of one caller, and those that were refused."""

    rest: deque[Subscription]
    done: Callable[[Refused], None]
    refused: dict[str, Answer] = field(default_factory=dict)


class Asking:
    """Sends the next SUBSCRIBE after the last one was answered. One thread owns it."""

    def __init__(self, send: Callable[[Sequence[Subscription]], object], most_filters: int) -> None:
        self._send = send
        self._most_filters = most_filters
        self._groups: deque[_Group] = deque()
        self._asked: list[Subscription] = []

    def ask(self, subscriptions: Sequence[Subscription], done: Callable[[Refused], None]) -> None:
        """Ask for these; call `done` with the refused ones when all are answered."""
        self._groups.append(_Group(deque(subscriptions), done))
        self._go_on()

    def answered(self, answers: Sequence[Answer]) -> None:
        """Handle the answer to the last SUBSCRIBE, filter by filter."""
        pairs = zip(self._asked, answers, strict=True)
        refused = {one.topic_filter: answer for one, answer in pairs if answer.is_failure}
        self._groups[0].refused.update(refused)
        self._asked = []
        self._go_on()

    def _go_on(self) -> None:
        while self._groups and not self._asked:
            group = self._groups[0]
            if not group.rest:
                self._groups.popleft()
                group.done(group.refused)
                continue
            count = min(self._most_filters, len(group.rest))
            self._asked = [group.rest.popleft() for _ in range(count)]
            self._send(self._asked)
