"""The bridge, except that one of its threads dies: `dying_bridge.py THREAD run -c FILE`."""

import sys
from itertools import count
from typing import NoReturn
from unittest.mock import patch

from bridge.cli.main import main

# What each thread calls all the time.
PLACES = {
    "line": "bridge.transport.bus.Bus.exchange",
    "mqtt": "bridge.mqtt.connection.Connection.step",
    "main": "bridge.mqtt.session.Session.tick",
}
CAUSE = "forced death"
_DIES_AT_CALL = 20


def dying(place: str) -> int:
    """Runs the bridge until that place was come to for the twentieth time."""
    calls = count(1)
    owner, _, name = place.rpartition(".")
    module, _, cls = owner.rpartition(".")
    original = getattr(getattr(__import__(module, fromlist=[cls]), cls), name)

    def call(*arguments: object, **named: object) -> object:
        return die() if next(calls) >= _DIES_AT_CALL else original(*arguments, **named)

    with patch(place, call):
        return main(sys.argv[2:])


def die() -> NoReturn:
    """Raise an error that no code expects."""
    raise RuntimeError(CAUSE)


if __name__ == "__main__":
    sys.exit(dying(PLACES[sys.argv[1]]))
