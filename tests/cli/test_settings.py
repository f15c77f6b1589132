"""`wisco2mqtt settings`: shown as YAML, compared, applied after a question, read back."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.commission_line import STATION, Laptop, config_of, line_of_one

from bridge.cli import main as cli
from bridge.model import LineProtocol, OutputSettings
from bridge.simulator import SimulatedModule

WANTED = "outputs:\n  2: {mode: pulse, hold: 0.5s}\n  3: {hold: 1.0s}\n"


@pytest.fixture(params=list(LineProtocol))
def laptop(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Laptop]:
    """On a line of each protocol."""
    monkeypatch.setattr(cli, "configure_logging", lambda *_: None)
    with line_of_one(request.param) as line:
        yield Laptop(capsys, line, config_of(tmp_path, line))


@pytest.fixture
def wanted(tmp_path: Path) -> str:
    """A file of settings."""
    path = tmp_path / "wanted.yaml"
    path.write_text(WANTED)
    return str(path)


wisco = pytest.mark.parametrize("laptop", [LineProtocol.WISCO], indirect=True)


def module(laptop: Laptop) -> SimulatedModule:
    """The one that is on the line."""
    return laptop.line.module(STATION)


def test_show_apply_and_diff(laptop: Laptop, wanted: str, tmp_path: Path) -> None:
    """The way of it: what differs is shown, written, and then nothing differs."""
    differing = "do/2 mode: latch -> pulse\ndo/2 hold: 1.0s -> 0.5s\n"
    done = laptop.on_station("settings", "diff", wanted)
    assert (done.status, done.out) == (1, differing)
    done = laptop.on_station("settings", "apply", wanted, "--yes")
    assert (done.status, done.out) == (0, differing)
    assert "2 registers written, and read back" in done.err
    assert module(laptop).settings == OutputSettings(0b10, (10, 5, *[10] * 6))
    assert module(laptop).eeprom_writes == 2
    assert laptop.on_station("settings", "diff", wanted).status == 0
    again = laptop.on_station("settings", "apply", wanted, "--yes")
    assert (again.status, again.out) == (0, "")
    assert module(laptop).eeprom_writes == 2
    shown = laptop.on_station("settings", "show")
    (tmp_path / "shown.yaml").write_text(shown.out)
    assert shown.out.startswith("# garage: station 13, 57600 baud")
    assert "  2: {mode: pulse, hold: 0.5s}\n" in shown.out
    assert (shown.err, laptop.on_station("settings", "diff", str(tmp_path / "shown.yaml")).out) == (
        "", ""
    )  # fmt: skip


@wisco
def test_nothing_is_written_unasked(laptop: Laptop, wanted: str) -> None:
    """Without a terminal to ask at, `apply` needs --yes."""
    done = laptop.on_station("settings", "apply", wanted)
    assert done.status == 2
    assert "add --yes" in done.err
    assert module(laptop).eeprom_writes == 0


@wisco
@pytest.mark.parametrize(
    ("answer", "writes"), [("y\n", 2), ("yes\n", 2), ("\n", 0), ("n\n", 0), ("", 0)]
)
def test_the_answer_is_taken(
    laptop: Laptop, wanted: str, monkeypatch: pytest.MonkeyPatch, answer: str, writes: int
) -> None:
    """A person at the terminal says yes, or nothing happens."""

    class Terminal:
        def isatty(self) -> bool:
            return True

        def readline(self) -> str:
            return answer

    monkeypatch.setattr("sys.stdin", Terminal())
    done = laptop.on_station("settings", "apply", wanted)
    assert done.status == 0
    assert "write this to garage? [y/N]" in done.err
    assert module(laptop).eeprom_writes == writes


@wisco
def test_a_wrong_file_is_named_with_its_place(laptop: Laptop, tmp_path: Path) -> None:
    """A fault in a settings file is reported with its place, with status 78."""
    path = tmp_path / "wrong.yaml"
    path.write_text("outputs:\n  9: {mode: pulse}\n")
    done = laptop.on_station("settings", "apply", str(path), "--yes")
    assert done.status == 78
    assert f"{path}:2:3: outputs: no output 9 here" in done.complaint


@wisco
def test_a_module_without_modbus_is_told(laptop: Laptop) -> None:
    """A module that takes only Wisco frames has no settings: one line says so."""
    module(laptop).wisco_only = True
    done = laptop.on_station("settings", "show")
    assert (done.status, "answers no Modbus frames" in done.complaint) == (1, True)


@wisco
def test_station_0_has_none(laptop: Laptop) -> None:
    """Station 0 has no settings, because 0 is the broadcast address of Modbus."""
    done = laptop.run("settings", "show", "--port", laptop.line.port, "--station", "0")
    assert (done.status, "broadcast" in done.complaint) == (2, True)


def test_json_is_for_programs(laptop: Laptop, wanted: str) -> None:
    """Show gives all settings, diff and apply what differs, and apply what it wrote."""
    shown = json.loads(laptop.on_station("settings", "show", "--json").out)
    assert shown["outputs"]["2"] == {"mode": "latch", "hold": 1.0}
    changes = [
        {"output": 2, "setting": "mode", "now": "latch", "wanted": "pulse"},
        {"output": 2, "setting": "hold", "now": "1.0s", "wanted": "0.5s"},
    ]
    done = laptop.on_station("settings", "diff", wanted, "--json")
    assert (done.status, json.loads(done.out)) == (1, {"changes": changes})
    done = laptop.on_station("settings", "apply", wanted, "--yes", "--json")
    assert json.loads(done.out) == {"changes": changes, "registers_written": 2}
