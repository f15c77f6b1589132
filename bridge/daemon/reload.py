"""Applies a changed configuration; unchanged lines keep running."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.daemon.heap import trim_heap
from bridge.daemon.systemd import Notifier
from bridge.errors import ConfigError
from bridge.hub.hub import Hub
from bridge.hub.line_set import LineSet
from bridge.mqtt.requests import BridgeRequest, RequestDesk, only
from bridge.mqtt.session import Session
from bridge.transport.lock import LockHeldError

_log = logging.getLogger(__name__)

_MOST_PROBLEMS = 20  # in an answer and in the log; `check` prints all of them


class Reload:
    """Reads the configuration again when it is asked to. Only the main thread calls it.

    A new configuration is read and checked whole before anything changes. Then the lines that it
    changes end, each after the exchange that it is in, while the others work on; and when they
    have ended, hub, session and lines go over to it in one go.

    Attributes:
        anew: The configuration to start anew with, as it names another broker, or makes us
            another client there; None: there is none.
    """

    def __init__(
        self,
        *,
        current: CurrentConfig,
        load: Callable[[], Config],
        lines: LineSet,
        hub: Hub,
        session: Session,
        desk: RequestDesk,
        notifier: Notifier,
        clock: Callable[[], float],
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._bounded = BoundedLog(_log, clock, budgets)
        self.anew: Config | None = None
        self._current = current
        self._load = load
        self._lines = lines
        self._hub = hub
        self._session = session
        self._desk = desk
        self._notifier = notifier
        self._clock = clock
        self._next: Config | None = None  # set while lines end
        self._askers: list[BridgeRequest] = []
        self._asked = False

    def open(self) -> None:
        """Register its request."""
        self._desk.serve("reload", self._requested, fresh_only=True)

    def ask(self) -> None:
        """Request that the configuration is read again."""
        self._asked = True

    def tick(self, drain: Callable[[], None]) -> None:
        """Do what is due. `drain` applies all events of the lines."""
        if self._next is not None:
            if self._lines.all_left:
                drain()
                self._go_over(self._next)
        elif self._asked:
            self._asked = False
            self._begin()

    def _requested(self, request: BridgeRequest) -> None:
        only(request)
        self._askers.append(request)
        self.ask()

    def _begin(self) -> None:
        self._notifier.reloading()
        try:
            config = self._load()
        except (ConfigError, LockHeldError) as error:
            self._refuse(error)
            return
        before = self._current.config
        if config == before:
            self._tell(logging.INFO, "the configuration says what it said before: nothing to do")
            self._end()
        elif _client_of(config) != _client_of(before):
            self._tell(
                logging.INFO,
                "the configuration changed at the broker or the panel: starting anew with it",
            )
            self.anew = config
            self._answer(
                {"kept": [], "stopped": list(self._lines.workers), "started": _ids(config)}
            )
        else:
            self._lines.replace(config.lines)
            self._next = config

    def _refuse(self, error: ConfigError | LockHeldError) -> None:
        problems = str(error).splitlines()  # one line for each
        told = "; ".join(problems[:_MOST_PROBLEMS])
        more = len(problems) - _MOST_PROBLEMS
        rest = f"; and {more} more, that `wisco2mqtt check` tells" if more > 0 else ""
        text = f"the configuration was not taken: the bridge runs on as it was: {told}{rest}"
        self._tell(logging.ERROR, text)
        for request in self._take_askers():
            self._desk.refuse(request, told)
        self._tell_ready()

    def _go_over(self, config: Config) -> None:
        kept, ended = list(self._lines.workers), self._lines.leaving
        started = [line.id for line in self._lines.coming]
        before, self._next = self._current.config, None
        self._current.replace(config)
        self._hub.config_replaced(ended)
        self._session.config_replaced(before, self._clock())
        self._lines.renew()
        self._hub.rules.tell_all()
        stopped = [line.id for line in ended]
        what = (("kept", kept), ("stopped", stopped), ("started", started))
        changes = "; ".join(f"{word}: {', '.join(names) or 'none'}" for word, names in what)
        self._tell(logging.INFO, f"the configuration changed: lines {changes}")
        self._answer({"kept": kept, "stopped": stopped, "started": started})
        self._tell_ready()

    def _end(self) -> None:
        self._answer({"kept": list(self._lines.workers), "stopped": [], "started": []})
        self._tell_ready()

    def _tell_ready(self) -> None:
        trim_heap()
        self._notifier.ready(f"{len(self._lines.workers)} lines")

    def _answer(self, data: Mapping[str, Any]) -> None:
        for request in self._take_askers():
            self._desk.answer(request, data)

    def _tell(self, level: int, text: str) -> None:
        self._bounded.tell(Cause.RELOAD, "", level, text)

    def _take_askers(self) -> list[BridgeRequest]:
        askers, self._askers = self._askers, []
        return askers


def _client_of(config: Config) -> tuple[object, ...]:
    """Return the values that connection and panel depend on: other values need a new `App`."""
    return (config.mqtt, config.homeassistant.status_topic, config.web)


def _ids(config: Config) -> list[str]:
    return [line.id for line in config.lines]
