"""Introduces the panel in the browser to the bridge, where one is configured."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.bounded_log import Budgets
from bridge.config.schema import Config
from bridge.daemon.wiring import Tree, wall_clock
from bridge.model import MainWork

if TYPE_CHECKING:
    from bridge.web.panel import WebPanel


def make_panel(
    config: Config, hand_over: Callable[[MainWork], None], path: Path | None, budgets: Budgets
) -> "WebPanel | None":
    """Return the panel; None: there is none, and then nothing of it is in memory."""
    if config.web is None:
        return None
    from bridge.web.config_file import config_file  # noqa: PLC0415
    from bridge.web.panel import WebPanel  # noqa: PLC0415

    return WebPanel(config.web, hand_over, wall_clock, config_file(path), budgets=budgets)


def start_panel(panel: "WebPanel | None", tree: Tree) -> None:
    """Start it, if there is one."""
    if panel is None:
        return
    from bridge.web.panel import PanelTies  # noqa: PLC0415

    tree.traces.listen = panel.traced
    panel.start(
        PanelTies(
            current=tree.current,
            submit=tree.hub.submit,
            reload=tree.reload.ask,
            trace=tree.traces.start,
            ask=tree.broker.desk.ask,
            broker_is_away=tree.broker.session.is_away,
        )
    )
