"""Commissioning in the panel: search a port, blink an output, propose and save a configuration."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.web_panel import PanelBench

from bridge.config.add_line import with_line
from bridge.config.load import config_of
from bridge.errors import BridgeError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.web.config_file import ConfigFile

FILE = "mqtt: {host: 127.0.0.1, username: u, password: hunter2}\nweb: {}  # the panel\n"


@pytest.fixture(name="line")
def _line(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimulatedLine]:
    """Two modules on a line that no configuration names; not at the pace of the wire."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 3)]
    modules[1].set_mode(2, pulse=True, hold_s=0.5)
    with SimulatedLine(LineProtocol.WISCO, 9600, modules, paced=False) as line:
        monkeypatch.setattr("bridge.web.setup.BAUDS", (9600,))
        monkeypatch.setattr("bridge.web.setup.STATIONS", range(1, 5))
        yield line


@pytest.fixture(name="bench")
def _bench(tmp_path: Path) -> Iterator[PanelBench]:
    path = tmp_path / "config.yaml"
    path.write_text(FILE)
    with PanelBench(file=ConfigFile(path, {"HOME": str(tmp_path)})) as bench:
        yield bench


def _scanned(bench: PanelBench, line: SimulatedLine) -> dict[str, Any]:
    """Search the port to its end."""
    assert bench.ask("POST", "/api/scan", {"port": line.port, "thorough": False}).status == 200
    bench.wait(lambda: bench.state()["state"].get("scan", {"running": True})["running"] is False)
    found: dict[str, Any] = bench.state()["state"]["scan"]
    return found


def test_modules_appear_with_their_switches_and_blink(
    bench: PanelBench, line: SimulatedLine
) -> None:
    """A search reads, and switches nothing; then an output of what was found blinks.

    A latch goes ON and OFF, a pulse gets one ON, what is ON already is left alone.
    """
    scan = _scanned(bench, line)
    assert scan["error"] is None
    assert [(one["address"], one["model"], one["pulse"]) for one in scan["found"]] == [
        (1, "DIO100", []),
        (3, "DO100", [2]),
    ]
    assert scan["found"][1]["dip"] == [True, True, False, False, False, True, False, True]
    for address, output in ((9, 1), (1, 9), (1, 0)):
        asked = {"address": address, "output": output}
        assert bench.ask("POST", "/api/blink", asked).status == 409, asked
    assert not any(line.module(address).switchings for address in (1, 3))

    assert bench.ask("POST", "/api/blink", {"address": 3, "output": 1}).status == 200
    assert [(s.output, s.value) for s in line.module(3).switchings] == [(1, True), (1, False)]

    assert bench.ask("POST", "/api/blink", {"address": 3, "output": 2}).status == 200
    assert [(s.output, s.value) for s in line.module(3).switchings if s.frame][2:] == [(2, True)]

    line.module(1).set_output(4, True)
    answer = bench.ask("POST", "/api/blink", {"address": 1, "output": 4})
    assert answer.status == 409
    assert "ON already" in answer.document["error"]


def test_the_proposal_keeps_the_rest_and_is_valid(
    bench: PanelBench, line: SimulatedLine, tmp_path: Path
) -> None:
    """Names in any language, and the modes as the module has them; then it is saved.

    A name is one line of text: it can add nothing to the file.
    """
    _scanned(bench, line)
    bad: list[object] = [
        [],
        {"1": []},
        {"x": {}},
        {"1": {"name": 5}},
        {"1": {"name": "a\nlines:"}},
        {"1": {"inputs": 1}},
    ]
    for wrong in bad:
        assert bench.ask("POST", "/api/proposal", {"names": wrong}).status == 409, wrong
    names = {
        "1": {"id": "garage", "name": 'โรงรถ "A"', "inputs": {"2": "Door"}, "outputs": {}},
        "3": {"outputs": {"2": "Gate: north", "5": ""}},
    }
    answer = bench.ask("POST", "/api/proposal", {"names": names}).document
    assert "hunter2" not in answer["text"]
    saved = bench.ask("PUT", "/api/config", {k: answer[k] for k in ("text", "version")})
    assert saved.status == 200

    config = config_of((tmp_path / "config.yaml").read_text(), tmp_path / "config.yaml", {})
    assert config.mqtt.password == "hunter2"  # noqa: S105  # no secret
    garage, other = config.lines[0].stations
    assert (garage.id, garage.name, garage.inputs[1].name) == ("garage", 'โรงรถ "A"', "Door")
    assert (other.id, other.outputs[1].name, other.outputs[1].mode) == (
        "main_03",
        "Gate: north",
        "pulse",
    )
    bench.wait(lambda: bench.reloads == 1)


def test_a_port_of_a_line_is_not_searched(bench: PanelBench) -> None:
    """The bridge polls it; what is no port is not opened."""
    busy = bench.ask("POST", "/api/scan", {"port": "/dev/null"})
    assert busy.status == 409
    assert "line main" in busy.document["error"]
    for port in ("/etc/passwd", "", "http://h:1", "/dev/../etc/passwd"):
        assert bench.ask("POST", "/api/scan", {"port": port}).status == 409


def test_a_port_that_is_gone_is_told(bench: PanelBench) -> None:
    """In words, at the end of the search."""
    bench.ask("POST", "/api/scan", {"port": "/dev/ttyUSB99"})
    bench.wait(lambda: bench.state()["state"].get("scan", {}).get("error"))
    assert bench.state()["state"]["scan"]["running"] is False


def test_a_search_can_be_stopped(bench: PanelBench, line: SimulatedLine) -> None:
    """And one at a time is made."""
    bench.ask("POST", "/api/scan", {"port": line.port, "thorough": True})
    second = bench.ask("POST", "/api/scan", {"port": line.port})
    bench.ask("POST", "/api/scan", {"stop": True})
    bench.wait(lambda: bench.state()["state"]["scan"]["running"] is False)
    assert second.status in {200, 409}
    assert bench.ask("POST", "/api/scan", {"port": line.port}).status == 200


def test_a_trace_is_started_and_ended(bench: PanelBench) -> None:
    """For a line that there is, and for ten minutes at most."""
    bench.ask("POST", "/api/trace", {"line": "main"})
    bench.ask("POST", "/api/trace", {"line": "main", "for_s": 0})
    bench.wait(lambda: bench.traces == [("main", 60.0), ("main", 0.0)])
    for asked in ({"line": "other"}, {"line": "main", "for_s": 601}, {"line": ["main"]}, {}):
        assert bench.ask("POST", "/api/trace", asked).status == 400


def test_the_ports_are_told(bench: PanelBench) -> None:
    """Those that there are on this machine: none, as a rule, where tests run."""
    assert isinstance(bench.ask("GET", "/api/ports").document["ports"], list)


# --- the text ---------------------------------------------------------------------------------


def _section(line_id: str) -> list[str]:
    return [f"  - id: {line_id}", "    port: /dev/ttyUSB0"]


ADDED = "  - id: main\n    port: /dev/ttyUSB0"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("web: {}", f"web: {{}}\n\nlines:\n{ADDED}\n"),
        ("web: {}\nlines:\n", f"web: {{}}\nlines:\n{ADDED}\n"),
        ("lines: []  # none\nweb: {}\n", f"lines:\n{ADDED}  # none\nweb: {{}}\n"),
        (
            "lines:\n# old\n- id: main\n  port: /x\nweb: {}\n",
            "lines:\n# old\n- id: line2\n  port: /dev/ttyUSB0\n- id: main\n  port: /x\nweb: {}\n",
        ),
        (
            "lines:\n    - id: line2\n      port: /x\n",
            "lines:\n    - id: line3\n      port: /dev/ttyUSB0\n    - id: line2\n      port: /x\n",
        ),
    ],
)
def test_a_line_is_added_and_the_rest_stays(text: str, expected: str) -> None:
    """Comments, order and indentation are those of the owner."""
    assert with_line(text, _section) == expected


@pytest.mark.parametrize("text", ["{web: {}}", "lines: [{id: main}]", "lines: {a: b}", "- a"])
def test_a_text_of_another_form_is_left_alone(text: str) -> None:
    """It is said, and nothing is guessed."""
    with pytest.raises(BridgeError):
        with_line(text, _section)
