"""The destination of the log, and the form of its lines."""

import os
import re
import subprocess
import sys
from pathlib import Path

SCRIPT = """
import logging, os, sys
from bridge.cli.frame.logs import configure_logging
environ = dict(os.environ)
if sys.argv[2] == "journal":
    status = os.fstat(2)
    environ["JOURNAL_STREAM"] = f"{status.st_dev}:{status.st_ino}"
elif sys.argv[2] == "inherited":
    environ["JOURNAL_STREAM"] = "8:1"
configure_logging(sys.argv[1], environ)
log = logging.getLogger("bridge.some")
log.debug("details")
log.info("first")
log.warning("second %s", "line\\nbreak\\r")
try:
    1 / 0
except ZeroDivisionError:
    log.exception("third")
"""


def lines_logged(tmp_path: Path, level: str, kind: str) -> list[str]:
    """Logs from a process whose stderr is a file, and gives the lines."""
    path = tmp_path / "log"
    environ = {key: value for key, value in os.environ.items() if key != "JOURNAL_STREAM"}
    with path.open("wb") as stderr:
        command = [sys.executable, "-c", SCRIPT, level, kind]
        subprocess.run(command, check=True, stderr=stderr, env=environ, timeout=30)
    return path.read_text().splitlines()


def test_a_line_has_time_level_and_name(tmp_path: Path) -> None:
    """On a terminal each line starts with ISO time in milliseconds, then the level."""
    line = lines_logged(tmp_path, "info", "terminal")[0]
    time = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d"
    assert re.fullmatch(rf"{time} INFO bridge\.some: first", line)


def test_an_event_is_one_line(tmp_path: Path) -> None:
    """An event with line breaks or a traceback is logged as one line."""
    lines = lines_logged(tmp_path, "info", "terminal")
    assert len(lines) == 3
    assert lines[1].endswith("WARNING bridge.some: second line\\nbreak\\r")
    assert "third\\nTraceback" in lines[2]
    assert lines[2].endswith("ZeroDivisionError: division by zero")


def test_the_journal_gets_priorities_and_no_time(tmp_path: Path) -> None:
    """The journal has its own clock and takes the level from the prefix."""
    lines = lines_logged(tmp_path, "debug", "journal")
    assert lines[:2] == ["<7>bridge.some: details", "<6>bridge.some: first"]
    assert lines[2].startswith("<4>bridge.some: second")
    assert lines[3].startswith("<3>bridge.some: third")


def test_an_inherited_variable_does_not_make_a_terminal_a_journal(tmp_path: Path) -> None:
    """A shell started by systemd passes JOURNAL_STREAM on, but its stderr is another file."""
    assert "INFO" in lines_logged(tmp_path, "info", "inherited")[0]


def test_the_level_is_the_least_that_is_logged(tmp_path: Path) -> None:
    """At `error` only errors are left."""
    lines = lines_logged(tmp_path, "error", "terminal")
    assert len(lines) == 1
    assert " ERROR bridge.some: third" in lines[0]
