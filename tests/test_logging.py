"""Nothing that can repeat goes past the bounded log: every direct call of a logger has a reason."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import bridge
from bridge.bounded_log import Cause

ROOT = Path(bridge.__file__).parent
LEVELS = {"info", "warning", "error", "critical", "exception", "log"}
# Where, and the only way in which it can come: once in a run of the process, or of a thread.
ALLOWED = {
    ("bounded_log.py", "log"): "the bounded log itself",
    ("daemon/app.py", "critical"): "a thread failed: the process ends",
    ("line/worker.py", "critical"): "the thread of a line dies, and the process with it",
    ("mqtt/client.py", "exception"): "the MQTT thread dies, and the process with it",
    ("web/server.py", "exception"): "the thread of the panel dies, and the process with it",
    ("cli/run.py", "info"): "the start, and the stop",
}


def _calls() -> Iterator[tuple[str, str, ast.Call]]:
    """Every call of a method that is named as a logger's is, with its file."""
    for path in sorted(ROOT.rglob("*.py")):
        where = path.relative_to(ROOT).as_posix()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                yield where, node.func.attr, node


def _is_logger(node: ast.expr) -> bool:
    """By the names that loggers have here; or straight from `logging`."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name in {"_log", "log", "logger", "_logger", "logging"}
        case ast.Call(func=ast.Attribute(attr="getLogger")):
            return True
    return False


def test_every_line_of_the_log_is_bounded() -> None:
    """A call of a logger that is no debugging is in the list, and the list has no more."""
    found = {
        (where, method)
        for where, method, call in _calls()
        if method in LEVELS and isinstance(call.func, ast.Attribute) and _is_logger(call.func.value)
    }
    assert found == set(ALLOWED)


@pytest.mark.parametrize("cause", Cause)
def test_every_cause_is_used(cause: Cause) -> None:
    """The list of causes is what the code has, and no more."""
    uses = [path for path in ROOT.rglob("*.py") if f"Cause.{cause.name}" in path.read_text()]
    assert uses
