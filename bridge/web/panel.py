"""The main thread's side of the panel: what is told to it, and what it asks for."""

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import count
from typing import Any

from bridge import __version__
from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.clock import boot_s
from bridge.config.current import CurrentConfig
from bridge.config.schema import Server, WebConfig
from bridge.errors import CommandError
from bridge.model import AnyCommand, MainWork, PublicEvent, Reason, Ticket, Verdict
from bridge.mqtt.requests import Reply
from bridge.web.api import Answer
from bridge.web.backup_api import AskBridge, BackupApi
from bridge.web.board import Board
from bridge.web.commands import Wish, command_of, refusal
from bridge.web.config_api import ConfigApi
from bridge.web.config_file import ConfigFile
from bridge.web.guest import Route
from bridge.web.panel_log import PanelLog
from bridge.web.server import PanelServer
from bridge.web.setup_api import SetupApi
from bridge.web.story import Story, verdict_document

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PanelTies:
    """What the panel needs of the main thread.

    Attributes:
        current: The configuration in force.
        submit: Takes commands, as from the broker.
        reload: Asks for the configuration to be read again.
        trace: Traces a line for a time; 0 s ends it.
        ask: Makes a request to the bridge, with its arguments and what takes the answer.
        broker_is_away: Tells whether the broker is away at an instant.
    """

    current: CurrentConfig
    submit: Callable[[AnyCommand], None]
    reload: Callable[[], None]
    trace: Callable[[str, float], object]
    ask: AskBridge
    broker_is_away: Callable[[float], bool]


class WebPanel:
    """Listens to the hub, and hands commands to it. Only the main thread calls it.

    The server has a thread of its own, and reaches the main thread by `hand_over` alone.
    """

    def __init__(
        self,
        web: WebConfig,
        hand_over: Callable[[MainWork], None],
        wall_clock: Callable[[], datetime],
        file: ConfigFile | None = None,
        *,
        budgets: Budgets | None = None,
        clock: Callable[[], float] = boot_s,
    ) -> None:
        """Args: `file` is that of the configuration; `budgets` are those of the log."""
        self._is_stopping = False
        self._web = web
        self._clock = clock
        self._board = Board()
        self._story = Story(self._board, clock)
        self._bounded = BoundedLog(_log, clock, budgets)
        self._ties: PanelTies | None = None
        self._tickets = count(1)
        self._verdicts: Counter[str] = Counter()  # all of them, by whichever way they came
        self._waiting: dict[int, Answer] = {}
        self._setup_api = SetupApi(
            self._board,
            file,
            lambda line, for_s: hand_over(MainWork(lambda: self._trace(line, for_s))),
        )
        self._backup_api = BackupApi(
            self._board,
            file,
            lambda *asked: hand_over(MainWork(lambda: self._ask(*asked))),
            wall_clock,
        )
        self._server = PanelServer(
            web,
            board=self._board,
            hand_over=lambda wish, at, answer: hand_over(
                MainWork(lambda: self._take(wish, at, answer))
            ),
            more=(
                *ConfigApi(file, lambda: hand_over(MainWork(self._reload))).routes,
                *self._setup_api.routes,
                *self._backup_api.routes,
            ),
            log=self._bounded,
            clock=clock,
        )
        self._log = PanelLog(self._story)

    def start(self, ties: PanelTies) -> None:
        """Begin to serve."""
        self._ties = ties
        self._setup_api.current = self._backup_api.current = ties.current
        self.tick(self._clock())
        self._server.start()
        logging.getLogger().addHandler(self._log)
        if not ties.current.config.lines:
            text = f"there are no lines yet: find the modules in the panel, at {self._url}"
            self._bounded.tell(Cause.PANEL, "lines", logging.WARNING, text)

    def hear(self, event: PublicEvent) -> None:
        """Take what the hub publishes."""
        if self._ties is not None:
            # After a reload a new line may tell of itself before the next tick.
            self._story.follow(self._ties.current)
        self._story.hear(event)
        if not isinstance(event, Verdict):
            return
        self._verdicts[event.status] += 1
        if isinstance(event.reply_to, Ticket):
            answer = self._waiting.pop(event.reply_to.number, None)
            if answer is not None:
                answer(200, verdict_document(event))

    def tick(self, now: float) -> None:
        """Tell what no event tells: the configuration, and whether the broker is there."""
        if self._ties is None:
            return
        self._board.progress = now
        self._story.follow(self._ties.current)
        broker = "away" if self._ties.broker_is_away(now) else "online"
        self._board.put(
            "bridge", {"version": __version__, "broker": broker, "commands": dict(self._verdicts)}
        )

    def stop(self) -> None:
        """End the server; what still waits for a verdict gets none."""
        self._setup_api.join()
        logging.getLogger().removeHandler(self._log)
        self._server.stop()

    def failure(self, stuck_before: float) -> str | None:
        """Return why the thread of the panel is not well, or None."""
        return self._server.failure(stuck_before)

    @property
    def routes(self) -> tuple[Route, ...]:
        """Return everything that can be asked."""
        return self._server.routes

    @property
    def _url(self) -> str:
        return f"http://{Server(self._web.host, self._web.port)}/"

    def traced(self, line: str, at: float, heard: Mapping[str, Any]) -> None:
        """Take what passed on a line that is traced."""
        self._story.traced(line, at, heard)

    def stopping(self) -> None:
        """Refuse commands from now on, as the bridge is being stopped; end a scan."""
        self._is_stopping = True
        self._setup_api.stop()

    def _trace(self, line: str, for_s: float) -> None:
        # The configuration may have changed since it was asked.
        if self._ties is not None and line in {one.id for one in self._ties.current.config.lines}:
            self._ties.trace(line, for_s)

    def _ask(self, verb: str, arguments: Mapping[str, Any], reply: Reply) -> None:
        if self._ties is not None:
            self._ties.ask(verb, arguments, reply)

    def _reload(self) -> None:
        if self._ties is not None and not self._is_stopping:
            self._ties.reload()

    def _take(self, wish: Wish, at: float, answer: Answer) -> None:
        """Take a command that the server handed over."""
        if self._ties is None:
            return
        ticket = Ticket(next(self._tickets))
        made = command_of(wish, ticket, at, self._ties.current, self._clock())
        if self._is_stopping and made is not None:
            error = CommandError(Reason.STOPPING, "the bridge is being stopped")
            made = refusal(wish, ticket, at, self._clock(), error)
        if made is None:
            answer(404, {"error": f"there is no station {wish.station_id!a:.60}"})
            return
        self._waiting[ticket.number] = answer
        if isinstance(made, Verdict):
            self.hear(made)
        else:
            self._ties.submit(made)
