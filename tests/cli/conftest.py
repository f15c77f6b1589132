"""A laptop at a panel, and its command lines run in this process, which is quick."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.laptop import Ended, Laptop
from support.mosquitto import free_port


@pytest.fixture
def laptop(tmp_path: Path, request: pytest.FixtureRequest) -> Laptop:
    """With the broker of the test if it has one, and without a panel."""
    has_broker = "mosquitto" in request.fixturenames
    broker_port = request.getfixturevalue("mosquitto").port if has_broker else free_port()
    return Laptop(tmp_path, broker_port)


@pytest.fixture
def call(
    laptop: Laptop, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], Ended]:
    """Runs a command line that ends soon."""
    return lambda line: laptop.call(line, monkeypatch, capsys)
