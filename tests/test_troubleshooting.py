"""docs/troubleshooting.md speaks of what the programs really print: each trouble is made here."""

import re
import select
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest
from support.daemon import Daemon
from support.laptop import Laptop, again_and_again, panel_of
from support.mosquitto import Mosquitto, free_port

from bridge.model import DO100, Reason
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.transport.opener import open_port

TEXT = " ".join((Path(__file__).parents[1] / "docs/troubleshooting.md").read_text().split())

Panel = tuple[Laptop, SimulatedLine]


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Panel]:
    """A panel with a laptop, and no broker; at the wire's pace, as replies have to collide."""
    laptop = Laptop(tmp_path, free_port())
    with panel_of(laptop, paced=True) as line:
        yield laptop, line


def _explained(message: str, printed: str) -> None:
    """A reader searches for the words that he sees."""
    assert message in TEXT
    assert message in " ".join(printed.split())


# --- what commands print ---


def _absent(panel: Panel) -> str:
    return panel[0].run("get --port /dev/ttyUSB7 --station 1").err


def _held(panel: Panel) -> str:
    port = open_port(panel[1].port, 9600)
    try:
        return panel[0].run("get garage").err
    finally:
        port.close()


def _silent(panel: Panel) -> str:
    panel[1].module(1).away = True
    return panel[0].run("get garage").err


def _nobody(panel: Panel) -> str:
    return panel[0].run("scan /dev/ttyUSB0 --baud 9600 --stations 7-8").err


def _unplugged(panel: Panel) -> str:
    laptop, line = panel
    with laptop.start("monitor /dev/ttyUSB0") as process:
        assert process.stdout
        assert process.stderr
        while not _heard(process.stdout, line):
            pass
        line.hang_up()
        return process.stderr.read()


def _heard(stdout: IO[str], line: SimulatedLine) -> bool:
    """Whether the monitor has the port by now: bytes that nobody hears are lost."""
    line.inject(b"#01RDI\r")
    ready, _, _ = select.select([stdout], [], [], 0.05)
    return bool(ready)


def _quiet(panel: Panel) -> str:
    return panel[0].run("monitor /dev/ttyUSB1 --for 100ms").err


def _another_model(panel: Panel) -> str:
    return panel[0].run("get --port /dev/ttyUSB0 --station 1 --model DO100").err


def _clash(panel: Panel) -> str:
    panel[1].modules[101] = SimulatedModule(DO100, 1)
    return panel[0].run("get --port /dev/ttyUSB0 --station 1").err


COMMANDS: list[tuple[Callable[[Panel], str], str]] = [
    (_absent, "no such device: is the adapter plugged in?"),
    (_held, "another program holds it: stop that one first"),
    (_silent, "does not answer wisco at 9600 baud on"),
    (_silent, "finds out who does"),
    (_nobody, "no module answered: is the panel powered, are A and B the right way round?"),
    (_unplugged, "the device hung up: is the adapter still plugged in?"),
    (_quiet, "nothing passed"),
    (_another_model, "but it answers an input read as a DIO100 does"),
    (_clash, "answers are garbled, as when two modules have one address"),
]


@pytest.mark.parametrize(("trouble", "message"), COMMANDS)
def test_what_a_command_says_is_explained(
    trouble: Callable[[Panel], str], message: str, panel: Panel
) -> None:
    """Each message of a command in the page is really printed."""
    _explained(message, trouble(panel))


# --- what the bridge logs ---


def _goes_away(line: SimulatedLine) -> None:
    line.module(2).away = True


def _is_another_model(line: SimulatedLine) -> None:
    line.modules[2] = SimulatedModule(line.module(1).model, 2)


def _switched_by_hand(line: SimulatedLine) -> None:
    line.module(2).set_output(3, value=True)


def _hung_up(line: SimulatedLine) -> None:
    line.hang_up()


LOGGED: list[tuple[Callable[[SimulatedLine], None], str, str]] = [
    (_goes_away, "station 2 (pumps): offline", "station 7 (pumps): offline"),
    (_switched_by_hand, "output 3 changed unasked to ON", "output 3 changed unasked to OFF"),
    (_hung_up, "hung up", "hung up"),
]


@pytest.mark.parametrize(("trouble", "logged", "explained"), LOGGED)
def test_what_the_bridge_logs_is_explained(
    trouble: Callable[[SimulatedLine], None],
    logged: str,
    explained: str,
    tmp_path: Path,
    mosquitto: Mosquitto,
) -> None:
    """Each log line in the page is really logged, with another station number."""
    laptop = Laptop(tmp_path, mosquitto.port)
    with panel_of(laptop) as line, Daemon(laptop.config) as daemon:
        daemon.wait_for_log("(pumps): online: DO100")
        trouble(line)
        daemon.wait_for_log(logged)
    assert f"`{explained}`" in TEXT or explained in TEXT


def test_another_model_is_logged(tmp_path: Path, mosquitto: Mosquitto) -> None:
    """The bridge says what it is, and leaves it alone."""
    laptop = Laptop(tmp_path, mosquitto.port)
    with panel_of(laptop) as line:
        _is_another_model(line)
        with Daemon(laptop.config) as daemon:
            daemon.wait_for_log("(garage): online")
            daemon.wait_for_log("answers an input read as a DIO100 does")
            _explained("but it answers an input read as a DIO100 does", daemon.log)
            assert "wrong model" in TEXT
            assert "wrong model" in daemon.log


def test_noise_alone_is_told(panel: Panel) -> None:
    """Bytes that make no frame and never pause, as at a wrong baud rate on a busy line."""
    laptop, line = panel
    with again_and_again(lambda: line.inject(b"\x55\xaa\x13")):
        printed = laptop.run("monitor /dev/ttyUSB1 --for 1s").err
    _explained("bytes, and not one frame", printed)


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_of_a_verdict_is_explained(reason: Reason) -> None:
    """Each tells what to do."""
    assert re.search(rf"`{reason}`", TEXT)
