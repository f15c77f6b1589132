"""Fixtures that more than one folder of tests uses."""

import logging
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from support.mosquitto import Mosquitto

# What starts a process, waits for the clock of the machine, or needs a broker.
_SLOW_FOLDERS = ("broker", "end_to_end", "rigs")
_SLOW_FIXTURES = {"mosquitto", "make_mosquitto"}
_SLOW_MODULES = {"subprocess", "support.daemon", "support.mosquitto", "support.person_screen"}
_HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as `slow` what `make check` leaves out; the others may not start a process."""
    for item in items:
        if isinstance(item, pytest.Function) and _is_slow(item):
            item.add_marker(pytest.mark.slow)


def _is_slow(item: pytest.Function) -> bool:
    if (
        not item.path.is_relative_to(_HERE)
        or item.path.relative_to(_HERE).parts[0] in _SLOW_FOLDERS
    ):
        return True
    used = {
        getattr(value, "__module__", None) or getattr(value, "__name__", None)
        for value in vars(item.module).values()
    }
    return bool(_SLOW_FIXTURES & set(item.fixturenames) or _SLOW_MODULES & used)


@pytest.fixture(autouse=True)
def _no_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A test that is not marked as slow starts no process: else `make check` would be slow."""
    if request.node.get_closest_marker("slow") is None:

        def refuse(*_arguments: object, **_options: object) -> NoReturn:
            raise AssertionError("a process is started by a test that is not marked as slow")

        monkeypatch.setattr(subprocess.Popen, "__init__", refuse)


class _Warnings(logging.Handler):
    """Keeps what is logged of warnings and errors."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.told: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one."""
        self.told.append(f"{record.levelname} {record.name}: {record.getMessage()}")


@pytest.fixture(autouse=True)
def _no_unexpected_warning(request: pytest.FixtureRequest) -> Iterator[None]:
    """A warning fails a test that neither looks at the log nor is marked with `warns`."""
    if "caplog" in request.fixturenames or request.node.get_closest_marker("warns"):
        yield
        return
    handler = _Warnings()
    logging.getLogger().addHandler(handler)
    yield
    logging.getLogger().removeHandler(handler)
    assert not handler.told, "this was logged and not expected (mark the test with `warns`?)"


@pytest.fixture(autouse=True)
def _log_as_it_was() -> Iterator[None]:
    """A command that a test ran in this process must not log into a later test's screen."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    yield
    root.setLevel(level)
    for handler in [one for one in root.handlers if one not in handlers]:
        root.removeHandler(handler)
    for handler in [one for one in handlers if one not in root.handlers]:
        root.addHandler(handler)


@pytest.fixture
def make_mosquitto(tmp_path: Path) -> Iterator[Callable[..., Mosquitto]]:
    """Makes started brokers with options of `Mosquitto`; ends them after the test."""
    made: list[Mosquitto] = []

    def make(**options: object) -> Mosquitto:
        broker = Mosquitto(tmp_path / f"mosquitto{len(made)}", **options)  # type: ignore[arg-type]  # passed on as they are
        made.append(broker)
        broker.start()
        return broker

    yield make
    for broker in made:
        broker.stop()


@pytest.fixture
def mosquitto(make_mosquitto: Callable[..., Mosquitto]) -> Mosquitto:
    """A started broker that asks for no password."""
    return make_mosquitto()
