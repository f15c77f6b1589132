"""The panel of `wisco2mqtt simulate`, as a person at a terminal sees it."""

import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.line_master import LineMaster
from support.person_screen import PATIENCE_S, PersonScreen

from bridge.cli.desk.panel_view import Look, draw, input_at, rows_of
from bridge.model import DIO100, DO100, ModuleType

SIMULATE = (sys.executable, "-m", "bridge", "simulate", "--module", "DIO100@1")
TWO = (*SIMULATE, "--module", "DO100@2", "--panel", "--unpaced")
LEAVE_THE_SCREEN = b"\x1b[?1049l"  # pyte has no second screen to come back from
IGNORING_HUP = ("sh", "-c", "trap '' HUP; exec \"$@\"", "sh")
NO_TEXTUAL = (
    "import sys; sys.modules['textual'] = None\n"
    "from bridge.cli.main import main\n"
    "sys.exit(main(['simulate', '--module', 'DIO100@1', '--panel']))"
)


def _leds(screen: str, number: int) -> str:
    """The LEDs of the bank with this number, from the top: 0 is the first module's inputs."""
    rows = [row for row in screen.splitlines() if "○" in row or "●" in row]
    return "".join(rows[number].split()) if len(rows) > number else ""


@pytest.fixture
def short_path() -> Iterator[str]:
    """Return a short path for a port: a long name would be wrapped on the screen."""
    with tempfile.TemporaryDirectory(prefix="p") as directory:
        yield str(Path(directory) / "port")


def test_keys_toggle_inputs_and_outputs_are_live(short_path: str) -> None:
    """A toggled input is read by a master, a switched output is shown, and `q` ends the panel."""
    path = short_path
    with PersonScreen((*TWO, "--pty", path)) as screen:
        screen.wait_for(f"line main: {path}, 9600 baud, wisco")
        screen.wait_for("1 DIO100")
        with LineMaster(path) as master:
            screen.type(" \x1b[C\x1b[C ")  # toggle 1, two to the right, toggle 3
            screen.wait_for(lambda seen: _leds(seen, 0) == "●○●" + "○" * 13)
            assert master.ask(b"#01RDIH\r", 8) == b"DI>0005\r"
            assert master.ask(b"#02WDO1,1\r", 6) == b"DO>OK\r"
            screen.wait_for(lambda seen: _leds(seen, 2) == "●" + "○" * 15)
            screen.wait_for("2 do/1 ON")
            screen.type("\x1b[Ba")  # down to the DO100, and away with it
            screen.wait_for("2 DO100  away")
            assert master.ask(b"#02RDOH\r", 8, patience_s=0.1) == b""
        screen.type("q")
        assert screen.wait_for_end() == 0


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_the_panel(end: signal.Signals) -> None:
    """SIGINT and SIGTERM end the panel and leave the terminal as it was."""
    with PersonScreen(TWO) as screen:
        screen.wait_for("1 DIO100")
        screen.process.send_signal(end)
        assert screen.wait_for_end() == 0
        _, _, after = screen.received.rpartition(LEAVE_THE_SCREEN)
        assert after
        assert "○".encode() not in after


@pytest.mark.parametrize("start", [(), IGNORING_HUP], ids=["plain", "nohup"])
def test_a_panel_ends_with_its_terminal(start: tuple[str, ...]) -> None:
    """The window is closed, and no signal tells it: the program ends by itself.

    By SIGHUP, or with the error of textual, which may find first that it cannot write.
    """
    with PersonScreen((*start, *TWO)) as screen:
        screen.wait_for("1 DIO100")
        screen.hang_up()
        assert screen.process.wait(PATIENCE_S) in {-signal.SIGHUP, 1}


def test_without_the_library_a_terminal_gets_one_clear_line() -> None:
    """Without textual one line says what to install, and orders on stdin work."""
    with PersonScreen((sys.executable, "-c", NO_TEXTUAL)) as screen:
        screen.wait_for("the panel's library textual is missing (extra `cli`)")
        screen.type("1 di/3 ON\nshow\n")
        screen.wait_for("1 DIO100: inputs ON 3; outputs ON none")


def test_without_a_terminal_one_line_says_so() -> None:
    """Stdout has what it has without the flag, and no escape sequences."""
    command = (*SIMULATE, "--panel")
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdin
        assert process.stdout
        assert process.stderr
        assert process.stderr.readline() == (
            "--panel needs a terminal, and this is none; lines on stdin drive the modules all the "
            "same\n"
        )
        assert process.stdout.readline().startswith("line main: /")
        process.stdin.write("1 di/3 ON\nshow\n")
        process.stdin.flush()
        assert process.stdout.readline() == "1 DIO100: inputs ON 3; outputs ON none\n"
        process.terminate()
        process.communicate()
    assert process.returncode == 0


@pytest.mark.parametrize("model", [DIO100, DO100])
def test_each_input_is_where_a_click_finds_it(model: ModuleType) -> None:
    """The number and the LED of an input are hit, and nothing beside them."""
    look = Look(away="", inputs=0, outputs=0, pulse=0)
    text = "".join(text for text, _ in draw("1", model, look, None))
    rows = text.splitlines()
    assert len(rows) == rows_of(model)
    for y, row in enumerate(rows):
        for x, character in enumerate(row):
            if y == 2 and model.inputs and character == "○":
                assert input_at(x, y, model) == int(rows[1][x - 1 : x + 1])
    assert len(set(filter(None, (input_at(x, 2, model) for x in range(100))))) == model.inputs
    assert {input_at(x, 4, model) for x in range(100)} == {None}


def test_a_pulse_output_is_marked() -> None:
    """An output in pulse mode has a mark, which explains why it goes OFF by itself."""
    look = Look(away="", inputs=0, outputs=0b10, pulse=0b10)
    rows = "".join(text for text, _ in draw("1", DO100, look, None)).splitlines()
    assert rows[1].split()[:4] == ["out", "1", "2p", "3"]
    assert rows[2].split()[:3] == ["○", "●", "○"]


def test_a_narrow_terminal_says_what_is_left_out() -> None:
    """Of 16 channels 9 fit into 50 columns, with the mark of the other 7."""
    look = Look(away="", inputs=0, outputs=0, pulse=0)
    spans = draw("1", DO100, look, None, columns=50)
    rows = "".join(text for text, _ in spans).splitlines()
    assert rows[1].split() == ["out", *map(str, range(1, 10)), "+7"]
    assert rows[2].split() == ["○"] * 9
    assert max(map(len, rows)) <= 50
