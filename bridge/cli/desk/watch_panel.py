"""The screen of `watch --panel`: the modules with their LEDs, from the broker. It needs textual."""

import time
from collections import deque
from datetime import datetime
from functools import partial
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Footer, Static

from bridge.cli.desk.house import House
from bridge.cli.desk.module_view import ModuleView
from bridge.cli.desk.terminal import end_with_terminal
from bridge.cli.through_broker.broker import Broker
from bridge.cli.views.watch_view import MessageWords
from bridge.errors import BridgeError
from bridge.mqtt.topics import Topics

_LOOK_S = 0.1
_LISTEN_S = 0.01
_NEWS_ROWS = 4


class WatchPanel(App[None]):
    """Looks at the broker ten times a second. `note` stays on the screen.

    Attributes:
        trouble: What ended it, if it was not the person who looks on.
    """

    ENABLE_COMMAND_PALETTE = False
    CSS = f"""
        #news {{ height: {_NEWS_ROWS + 1}; border-top: solid $primary; padding: 0 1; }}
        #note {{ height: auto; padding: 0 1; }}
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q,ctrl+c", "quit", "quit", key_display="q", priority=True)
    ]

    def __init__(
        self, broker: Broker, topics: Topics, station_ids: list[str], note: str = ""
    ) -> None:
        super().__init__(ansi_color=True)
        self.trouble: BridgeError | None = None
        self._broker = broker
        self._house = House(topics, station_ids)
        self._words = MessageWords(None, topics.base, colour=False)
        self._note = note
        self._news: deque[str] = deque(maxlen=_NEWS_ROWS)
        self._shown: dict[str, object] = {}

    def compose(self) -> ComposeResult:
        """Return the modules; what stays on the screen; what happened; the keys."""
        yield VerticalScroll(Static("waiting for the bridge", id="empty"), id="modules")
        if self._note:
            yield Static(self._note, id="note", markup=False)
        yield Static(id="news", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Start the redraws."""
        end_with_terminal()
        self.set_interval(_LOOK_S, self._look)

    async def _look(self) -> None:
        try:
            self._listen()
        except BridgeError as error:
            self.trouble = error
            self.exit()
            return
        if self._house.models and self._house.models != self._shown:
            await self._build()
        for view in self.query(ModuleView):
            view.look()

    def _listen(self) -> None:
        for message in self._broker.messages(time.monotonic() + _LISTEN_S):
            self._house.receive(message)
            line = None if message.retain else self._words.line(message, datetime.now())  # noqa: DTZ005  # for the eye
            if line is not None:
                self._news.append(line)
                self.query_one("#news", Static).update("\n".join(self._news))

    async def _build(self) -> None:
        self._shown = dict(self._house.models)
        modules = self.query_one("#modules")
        await modules.remove_children()
        await modules.mount_all(
            ModuleView(name, model, partial(self._house.look, station_id))
            for station_id, (name, model) in self._house.models.items()
        )
