"""The panel of `simulate`: the modules with their LEDs, live, and keys that toggle inputs.

With `--panel` it replaces the console.
"""

import queue
import sys
from collections.abc import Callable, Mapping
from typing import Self

from bridge.installed import how_to_add
from bridge.simulator.line import SimulatedLine


class Panel:
    """Shows the panel. The main thread owns it; other threads may only call `post`."""

    def __init__(self) -> None:
        self._news: queue.Queue[str] = queue.Queue()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def post(self, text: str) -> None:
        """Show a line of text, from any thread."""
        self._news.put(text)

    def attend(self, lines: Mapping[str, SimulatedLine], stopped: Callable[[], object]) -> None:
        """Show the lines until `stopped` returns something, or `q` is pressed."""
        from bridge.cli.desk.panel_app import PanelApp  # noqa: PLC0415  # needs an extra

        PanelApp(lines, self._news, stopped).run()


def objection_to_panel() -> str | None:
    """Return why the panel cannot be shown here, or None."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        return "--panel needs a terminal, and this is none"
    try:
        import bridge.cli.desk.panel_app  # noqa: F401, PLC0415  # an extra, and only here
    except ImportError:
        return f"the panel's library textual is missing (extra `cli`): {how_to_add('textual')}"
    return None
