"""One module on the screen of a panel. It needs textual, an extra."""

from collections.abc import Callable

from textual.content import Content
from textual.widget import Widget

from bridge.cli.desk.panel_view import COLUMNS, Look, draw, rows_of
from bridge.model import ModuleType


class ModuleView(Widget):
    """One module. `cursor` is its selected input, 0 if it has none; None: another is selected."""

    DEFAULT_CSS = f"ModuleView {{ width: 100%; max-width: {COLUMNS}; margin-bottom: 1; }}"

    def __init__(self, name: str, model: ModuleType, look: Callable[[], Look]) -> None:
        super().__init__()
        self.model = model
        self.styles.height = rows_of(model)
        self.cursor: int | None = None
        self._called = name
        self._see = look
        self._look = look()

    def look(self) -> None:
        """Draw it again if it has changed."""
        look = self._see()
        if look != self._look:
            self._look = look
            self.refresh()

    def put_cursor(self, channel: int | None) -> None:
        """Select an input, or (None) nothing of this module."""
        self.cursor = channel
        self.refresh()

    def render(self) -> Content:
        """Return the content for textual."""
        columns = self.size.width
        return Content.assemble(*draw(self._called, self.model, self._look, self.cursor, columns))
