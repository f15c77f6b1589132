"""What flaps at the panel in the browser, on a virtual clock."""

import asyncio
import logging
from unittest import mock

from bridge.bounded_log import BoundedLog
from bridge.config.schema import WebConfig
from bridge.web.board import Board
from bridge.web.server import PanelServer
from proofs.flapping import Flap


def listening(flap: Flap) -> None:
    """Another program has the port of the panel, and lets it go."""
    server = PanelServer(
        WebConfig(),
        board=Board(),
        hand_over=lambda *_: None,
        more=(),
        log=BoundedLog(logging.getLogger("bridge.web"), flap.now, flap.budgets),
        clock=flap.now,
    )

    def again(*, fails: bool) -> None:
        error = OSError(98, "Address already in use") if fails else None
        with mock.patch.object(asyncio, "start_server", mock.AsyncMock(side_effect=error)):
            asyncio.run(server._listen())

    flap.alternate(lambda: again(fails=True), lambda: again(fails=False))
