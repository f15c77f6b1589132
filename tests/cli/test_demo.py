"""The demo as a newcomer runs it: it says what to type, and that works."""

import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

WAIT_S = 30.0
STOPPED_WITHIN_S = 2.0


@pytest.fixture
def demo(tmp_path: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A running demo whose screen is the file `screen`."""
    with (tmp_path / "screen").open("wb") as screen:
        command = [sys.executable, "-m", "bridge", "demo"]
        with subprocess.Popen(command, stdout=screen, stderr=screen) as process:
            yield process
            process.kill()


def _wait_for(screen: Path, pattern: str) -> re.Match[str]:
    deadline = time.monotonic() + WAIT_S
    while (found := re.search(pattern, screen.read_text(errors="replace"))) is None:
        assert time.monotonic() < deadline, screen.read_text(errors="replace")
        time.sleep(0.02)  # a screen tells nobody that it changed: it is looked at again
    return found


def test_what_the_screen_says_to_type_works_and_ctrl_c_ends_it(
    demo: "subprocess.Popen[bytes]", tmp_path: Path
) -> None:
    """Inputs change by themselves, a send is done, Ctrl-C leaves offline within 2 s."""
    screen = tmp_path / "screen"
    _wait_for(screen, r"Ctrl-C ends the demo")
    sends = re.findall(r"^  (.* send .*)$", screen.read_text(), flags=re.MULTILINE)
    _wait_for(screen, r"\(pumps\): online: DO100")
    _wait_for(screen, r"garage/di/1 ON")
    for line in sends:
        done = subprocess.run(shlex.split(line), capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert ": done in " in done.stdout
    _wait_for(screen, r"pumps/do/16 ON")
    assert len(sends) == 3
    began = time.monotonic()
    demo.send_signal(signal.SIGINT)
    assert demo.wait(WAIT_S) == 0
    assert time.monotonic() - began < STOPPED_WITHIN_S
    shown = screen.read_text()
    assert "bridge/state offline" in shown
    assert "Traceback" not in shown
