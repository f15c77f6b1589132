"""On another broker than mosquitto: marks what cannot hold there, and tells the figures."""

import pytest
from support import brokers
from support.broker_gaps import CANNOT_HOLD, NOT_OF_IT


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each listed case, with its reason."""
    if brokers.NAME == "mosquitto":
        return
    for item in items:
        case = f"{item.path.name}::{item.name}"
        if reason := CANNOT_HOLD[brokers.NAME].get(case):
            item.add_marker(pytest.mark.xfail(reason=reason, strict=True))
        if reason := NOT_OF_IT.get(case):
            item.add_marker(pytest.mark.skip(reason=reason))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tell how many cases ran, and which ones cannot hold."""
    if brokers.NAME == "mosquitto":
        return
    stats = terminalreporter.stats
    cannot, ran_not = stats.get("xfailed", []), stats.get("skipped", [])
    held, broken = len(stats.get("passed", [])), len(stats.get("failed", []))
    terminalreporter.section(f"end to end on {brokers.version()}")
    terminalreporter.line(
        f"{held + len(cannot) + broken} cases run: {held} hold, {len(cannot)} cannot hold there, "
        f"{broken} fail; {len(ran_not)} not run"
    )
    for report in cannot:
        terminalreporter.line(f"cannot hold: {report.nodeid}: {report.wasxfail}")
    for report in ran_not:
        terminalreporter.line(f"not run: {report.nodeid}: {report.longrepr[-1]}")
