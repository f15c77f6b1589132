"""The demo as a newcomer runs it: it says what to type, and that works."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.person_screen import PersonScreen

WAIT_S = 30.0
STOPPED_WITHIN_S = 2.0


@pytest.fixture
def demo(tmp_path: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A running demo whose screen is the file `screen`."""
    with (tmp_path / "screen").open("wb") as screen:
        command = [sys.executable, "-m", "bridge", "demo"]
        home = os.environ | {"HOME": str(tmp_path)}
        with subprocess.Popen(command, stdout=screen, stderr=screen, env=home) as process:
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
    _wait_for(screen, r"garage +input 1 Door +ON")
    (path,) = re.findall(r"^  export PATH=~(.*):\$PATH$", screen.read_text(), flags=re.MULTILINE)
    typing = {"PATH": f"{tmp_path}{path}:{os.environ['PATH']}", "HOME": str(tmp_path)}
    for line in sends:
        done = subprocess.run(
            ["sh", "-c", line], capture_output=True, text=True, check=False, env=typing
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert ": done in " in done.stdout
    _wait_for(screen, r"pumps +output 16 +ON")
    assert len(sends) == 3
    began = time.monotonic()
    demo.send_signal(signal.SIGINT)
    assert demo.wait(WAIT_S) == 0
    assert time.monotonic() - began < STOPPED_WITHIN_S
    shown = screen.read_text()
    assert re.search(r"bridge +offline", shown)
    assert not (tmp_path / ".wisco2mqtt-demo").exists()
    assert "Traceback" not in shown


def test_at_a_terminal_it_draws_the_modules(tmp_path: Path) -> None:
    """What to type stays on the screen; `q` ends the demo, and leaves nothing behind."""
    with PersonScreen((sys.executable, "-m", "bridge", "demo"), HOME=str(tmp_path)) as screen:
        screen.wait_for("garage Garage DIO100")
        screen.wait_for("  wisco2mqtt send garage do/1 ON")
        screen.wait_for(lambda seen: "●" in seen)
        screen.type("q")
        assert screen.wait_for_end() == 0
    assert not list(tmp_path.iterdir())
