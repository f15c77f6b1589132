"""Fixtures of the tests, and the figures that are printed at the end."""

from collections.abc import Iterator

import pytest
from home_assistant.figures import told
from home_assistant.home import WAYS, Home, home, started_broker
from home_assistant.houses import EVERYTHING


@pytest.fixture(scope="module", params=WAYS)
def everything(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Home]:
    """Every kind of entity in each release and each form that it knows; tests share it."""
    release, discovery = request.param
    directory = tmp_path_factory.mktemp("everything")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, EVERYTHING, discovery) as shared,
    ):
        yield shared


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Prints what was measured, if these tests ran: pytest reads this file in any case."""
    figures = told()
    if figures:
        terminalreporter.section("figures")
    for line in figures:
        terminalreporter.write_line(line)
