"""Requests to the bridge other than a reload."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from bridge.mqtt.announce.announcer import Announcer
from bridge.mqtt.publisher import MqttPublisher
from bridge.mqtt.requests import BridgeRequest, RequestDesk, only
from bridge.mqtt.strict_json import bad

_LEVELS = ("debug", "info", "warning", "error")


class Services:
    """Answers `log_level`, `purge` and `diagnostics`. Only the main thread calls it."""

    def __init__(
        self,
        desk: RequestDesk,
        announcer: Announcer,
        publisher: MqttPublisher,
        clock: Callable[[], float],
    ) -> None:
        self._desk = desk
        self._announcer = announcer
        self._publisher = publisher
        self._clock = clock

    def open(self) -> None:
        """Register its requests."""
        self._desk.serve("log_level", log_level)
        self._desk.serve("diagnostics", self._diagnostics)
        self._desk.serve("purge", self._purge, fresh_only=True)

    def _diagnostics(self, request: BridgeRequest) -> Mapping[str, Any]:
        only(request)
        return self._publisher.diagnostics()

    def _purge(self, request: BridgeRequest) -> None:
        only(request)
        self._announcer.purge(
            lambda topics: self._desk.answer(request, {"cleared": topics}), self._clock()
        )


def log_level(request: BridgeRequest) -> Mapping[str, Any]:
    """Set the level of the log, if one is given; return the present level."""
    only(request, "level")
    root = logging.getLogger()
    level = request.arguments.get("level")
    if "level" in request.arguments:
        if level not in _LEVELS:
            raise bad(f"level is none of {', '.join(_LEVELS)}")
        root.setLevel(str(level).upper())
    return {"level": logging.getLevelName(root.level).lower()}
