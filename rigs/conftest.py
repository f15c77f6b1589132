"""Fixtures of the rigs: a broker, as the tests have it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.mosquitto import Mosquitto


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    """A started broker that asks for no password."""
    broker = Mosquitto(tmp_path / "mosquitto")
    broker.start()
    yield broker
    broker.stop()
