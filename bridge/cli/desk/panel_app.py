"""The screen of the panel of `simulate`. Only this file imports textual, an extra."""

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from queue import Queue
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.events import Click
from textual.widgets import Footer, Static

from bridge.cli.desk.module_view import ModuleView
from bridge.cli.desk.panel_view import Look, input_at
from bridge.cli.desk.terminal import end_with_terminal
from bridge.simulator.actions import DriveInput, InputWord, MoveModule
from bridge.simulator.control import place_of
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

_LOOK_S = 0.1
_NEWS_ROWS = 4


class PanelApp(App[None]):
    """Draws the modules ten times a second; the keys do the same as orders on stdin."""

    ENABLE_COMMAND_PALETTE = False
    CSS = f"""
        #news {{ height: {_NEWS_ROWS + 1}; border-top: solid $primary; padding: 0 1; }}
        .line {{ padding: 0 1; }}
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left", "step(-1)", "input", key_display="← →"),
        Binding("right", "step(1)", show=False),
        Binding("up", "move(-1)", show=False),
        Binding("down", "move(1)", "module", key_display="↑ ↓"),
        Binding("space,enter", "toggle_input", "toggle", key_display="space"),
        Binding("a", "away", "away / back"),
        Binding("q,ctrl+c", "quit", "quit", key_display="q", priority=True),
    ]

    def __init__(
        self, lines: Mapping[str, SimulatedLine], news: Queue[str], stopped: Callable[[], object]
    ) -> None:
        super().__init__(ansi_color=True)
        self._lines = lines
        self._incoming = news
        self._stopped = stopped
        self._news: deque[str] = deque(maxlen=_NEWS_ROWS)
        places = [
            (line.name, module) for line in lines.values() for module in line.modules.values()
        ]
        self._modules = [module for _, module in places]
        self._views = [
            ModuleView(
                place_of(name, module.address, several=len(lines) > 1),
                module.model,
                partial(Look.at, module),
            )
            for name, module in places
        ]
        self._chosen = 0

    def compose(self) -> ComposeResult:
        """Yield the modules of each line below its name, then messages and keys."""
        views = iter(self._views)
        with VerticalScroll(can_focus=False):
            for line in self._lines.values():
                where = f"line {line.name}: {line.port}, {line.baud} baud, {line.protocol}"
                yield Static(where, classes="line", markup=False)
                for _ in line.modules:
                    yield next(views)
        yield Static(id="news", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Start the redraws."""
        end_with_terminal()
        self._choose(0, 1)
        self.set_interval(_LOOK_S, self._look)

    def on_click(self, event: Click) -> None:
        """Toggle the input that was clicked."""
        if isinstance(event.widget, ModuleView):
            view = event.widget
            channel = input_at(event.x, event.y, view.model)
            self._choose(self._views.index(view), channel or view.cursor or 1)
            if channel:
                self.action_toggle_input()

    def action_step(self, by: int) -> None:
        """Go to the next input of this module."""
        if self._views:
            self._choose(self._chosen, (self._view.cursor or 0) + by)

    def action_move(self, by: int) -> None:
        """Go to the next module, at the same input."""
        if self._views:
            self._choose(self._chosen + by, self._view.cursor or 1)

    def action_toggle_input(self) -> None:
        """Toggle the selected input."""
        if self._views and self._view.cursor:
            DriveInput(self._module, self._view.cursor, InputWord.TOGGLE).do()
            self._look()

    def action_away(self) -> None:
        """Take the module off its line, or put it back."""
        if self._views:
            MoveModule(self._module, not self._module.away).do()
            self._look()

    @property
    def _view(self) -> ModuleView:
        return self._views[self._chosen]

    @property
    def _module(self) -> SimulatedModule:
        return self._modules[self._chosen]

    def _choose(self, number: int, channel: int) -> None:
        if not self._views:
            return
        self._view.put_cursor(None)
        self._chosen = min(max(number, 0), len(self._views) - 1)
        inputs = self._view.model.inputs
        self._view.put_cursor(min(max(channel, 1), inputs) if inputs else 0)
        self._view.scroll_visible(animate=False)

    def _look(self) -> None:
        if self._stopped():
            self.exit()
        for view in self._views:
            view.look()
        while not self._incoming.empty():
            self._news.append(self._incoming.get())
            self.query_one("#news", Static).update("\n".join(self._news))
