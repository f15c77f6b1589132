"""Fixtures that more than one folder of tests uses."""

import gc
import logging
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import settings
from support.mosquitto import Mosquitto

# A busy machine may pause in any example.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

# What starts a process, waits for the clock of the machine, or needs a broker.
_SLOW_FOLDERS = (None, "broker", "end_to_end", "rigs")
_SLOW_FIXTURES = {"mosquitto", "make_mosquitto"}
_SLOW_MODULES = {"subprocess", "support.daemon", "support.mosquitto", "support.person_screen"}
_HERE = Path(__file__).parent
# The parts with a lower limit of coverage. Only their own tests are measured.
_PYPROJECT = tomllib.loads((_HERE.parent / "pyproject.toml").read_text())
_MEASURED = {part.partition(".")[2] for part in _PYPROJECT["tool"]["coverage"]["run"]["source"]}


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the collector of garbage off the tests' own objects: they all stay to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as `slow` what `make check` leaves out; the others may not start a process."""
    for item in items:
        if isinstance(item, pytest.Function) and _is_slow(item):
            item.add_marker(pytest.mark.slow)


def _is_slow(item: pytest.Function) -> bool:
    if _folder(item) in _SLOW_FOLDERS:
        return True
    used = {
        getattr(value, "__module__", None) or getattr(value, "__name__", None)
        for value in vars(item.module).values()
    }
    return bool(_SLOW_FIXTURES & set(item.fixturenames) or _SLOW_MODULES & used)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Take the tracer of coverage off a test that is not measured: it runs three times as fast.

    The marker `no_cover` of pytest-cov does not do this in a worker of xdist. Two measurements
    run there, one over the other, and the lower one goes on when the upper one stops.
    """
    if _is_measured(item):
        return (yield)
    tracer, thread_tracer = sys.gettrace(), threading.gettrace()
    sys.settrace(None)
    threading.settrace(None)
    try:
        return (yield)
    finally:
        threading.settrace(thread_tracer)
        sys.settrace(tracer)


def _is_measured(item: pytest.Item) -> bool:
    folder = _folder(item)
    if folder not in _MEASURED or item.get_closest_marker("unmeasured"):
        return False
    # A test of a line is run for each protocol and module: the first case shows its lines.
    return folder != "line" or not any(_cases(item))


def _cases(item: pytest.Item) -> Iterable[int]:
    """Return which value of each parameter this case has."""
    callspec = getattr(item, "callspec", None)
    return callspec.indices.values() if callspec else ()


def _folder(item: pytest.Item) -> str | None:
    """Return the folder below tests/, or None for a test of a rig."""
    return item.path.relative_to(_HERE).parts[0] if item.path.is_relative_to(_HERE) else None


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
