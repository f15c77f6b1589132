"""Commands and events of the panel: the same hub, the same rules, the same verdicts."""

import http.client
import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from support.web_panel import WAIT_S, PanelBench

from bridge.clock import boot_s
from bridge.model import (
    AnyCommand,
    Command,
    LineChanged,
    ProblemChanged,
    StationChanged,
    Status,
    ValuesChanged,
    channels_of,
    verdict_on,
)


@pytest.fixture(name="bench")
def _bench() -> Iterator[PanelBench]:
    with PanelBench() as bench:
        yield bench


class Listener:
    """A browser that reads events."""

    def __init__(self, bench: PanelBench) -> None:
        self._bench = bench
        self._connection = http.client.HTTPConnection("127.0.0.1", bench.web.port, timeout=WAIT_S)
        self._connection.request("GET", "/api/events")
        self._answer = self._connection.getresponse()

    def next(self) -> tuple[str, Any]:
        """Return the next event: its name and what it tells."""
        name = self._answer.readline().decode().strip().removeprefix("event: ")
        data = json.loads(self._answer.readline().decode().strip().removeprefix("data: "))
        assert self._answer.readline() == b"\n"
        return name, data

    def until(self, name: str) -> Any:
        """Return what the next event of this name tells."""
        while True:
            found, data = self.next()
            if found == name:
                return data

    def close(self) -> None:
        """Go away."""
        self._answer.close()
        self._connection.close()


def test_a_command_is_answered_with_its_verdict(bench: PanelBench) -> None:
    """It says that the panel sent it; the deadline is that of MQTT."""
    answer = bench.command("garage", "do/1", "ON", id="x1")
    assert answer.status == 200
    verdict = answer.document
    assert {key: verdict[key] for key in ("target", "payload", "id", "status", "by")} == {
        "target": "do/1",
        "payload": "ON",
        "id": "x1",
        "status": "done",
        "by": "panel",
    }
    (command,) = bench.line.commands
    assert isinstance(command, Command)
    assert command.deadline == command.arrived + 2.0


@pytest.mark.parametrize(
    ("station_id", "target", "payload", "more", "reason"),
    [
        ("garage", "do/3", "ON", {}, "read_only"),
        ("garage", "do/2", "TOGGLE", {}, "bad_payload"),
        ("garage", "do/99", "ON", {}, "no_such_channel"),
        ("garage", "do/1", "MAYBE", {}, "bad_payload"),
        ("garage", "do/1", "ON", {"deadline": 99}, "bad_payload"),
        ("garage", "do/1", "ON", {"retain": True}, "bad_payload"),
        ("garage", "di/1", "ON", {}, "bad_payload"),
        ("garage", "do", {"1": "ON", "3": "ON"}, {}, "read_only"),
        ("garage", "do/1", {"deep": {"er": 1}}, {}, "bad_payload"),
    ],
)
def test_what_mqtt_refuses_the_panel_refuses(
    bench: PanelBench, station_id: str, target: str, payload: object, more: Any, reason: str
) -> None:
    """By the same rules, and with the same reason."""
    verdict = bench.command(station_id, target, payload, **more).document
    assert (verdict["status"], verdict["reason"]) == ("refused", reason)
    assert bench.line.commands == []


def test_an_unknown_station_is_named(bench: PanelBench) -> None:
    """There is no verdict where there is no station."""
    answer = bench.command("shed", "do/1", "ON")
    assert answer.status == 404
    assert "shed" in answer.document["error"]


def test_an_offline_module_is_refused(bench: PanelBench) -> None:
    """As over MQTT."""
    bench.hear(StationChanged("garage", online=False, detail="it is silent"))
    assert bench.command("garage", "do/1", "ON").document["reason"] == "offline"


def test_the_same_id_is_a_duplicate(bench: PanelBench) -> None:
    """Whichever way it came."""
    bench.command("garage", "do/1", "ON", id="x1")
    assert bench.command("garage", "do/1", "ON", id="x1").document["reason"] == "duplicate"


def test_the_deadline_counts_from_the_press(bench: PanelBench) -> None:
    """A telephone that held a press back for a second leaves it one second."""
    hello = bench.state()
    pressed = hello["now"] - 1.0
    bench.command("garage", "do/1", "ON", at=pressed, run=hello["run"])
    (command,) = bench.line.commands
    assert command.deadline == pytest.approx(pressed + 2.0)


def test_a_page_from_before_a_restart_switches_nothing(bench: PanelBench) -> None:
    """It shows what is not true any more, and its clock is another."""
    answer = bench.command("garage", "do/1", "ON", at=boot_s(), run="of another day")
    assert answer.document["reason"] == "stale_link"
    assert bench.line.commands == []


@pytest.mark.parametrize("more", [{"at": 1.0}, {"run": "x"}, {"at": "now"}, {"at": True}])
def test_half_of_a_time_is_none(bench: PanelBench, more: Any) -> None:
    """`at` and `run` go together, and `at` is a number."""
    run = bench.state()["run"] if "at" in more and more["at"] != 1.0 else more.get("run")
    asked = {**more, **({"run": run} if run and "at" in more else {})}
    answer = bench.command("garage", "do/1", "ON", **asked)
    assert answer.document["reason"] == "bad_payload"
    assert bench.line.commands == []


def test_a_press_in_the_future_is_refused(bench: PanelBench) -> None:
    """Its deadline would be too late."""
    hello = bench.state()
    answer = bench.command("garage", "do/1", "ON", at=hello["now"] + 60, run=hello["run"])
    assert answer.document["reason"] == "bad_payload"


@pytest.mark.parametrize("at", ["NaN", "Infinity"])
def test_a_press_at_no_instant_is_refused(bench: PanelBench, at: str) -> None:
    """Python reads these words as numbers."""
    run = bench.state()["run"]
    body = f'{{"station":"garage","target":"do/1","payload":"ON","at":{at},"run":"{run}"}}'
    verdict = bench.ask("POST", "/api/command", body.encode()).document
    assert verdict["reason"] == "bad_payload"
    assert bench.line.commands == []


def test_a_stop_refuses_commands(bench: PanelBench) -> None:
    """As over MQTT: a line that ends takes none."""
    bench.panel.stopping()
    assert bench.command("garage", "do/1", "ON").document["reason"] == "stopping"


def test_a_browser_is_told_all_first_and_then_what_is_new(bench: PanelBench) -> None:
    """Within one stream: nothing is lost between the two."""
    bench.hear(ValuesChanged("garage", 0b1, 0))
    listener = Listener(bench)
    assert listener.next()[0] == "hello"
    keys = {listener.until("state")["key"] for _ in range(5)}
    assert keys == {"bridge", "house", "line/main", "station/garage", "station/main_02"}

    bench.hear(ValuesChanged("garage", 0b10, 0))
    changed = listener.until("state")
    assert changed["key"] == "station/garage"
    assert changed["value"]["di"]["on"] == [2]
    assert listener.until("happened")["target"] == "di/1"
    listener.close()


def test_a_slow_browser_gets_the_newest_state(bench: PanelBench) -> None:
    """Of many values it gets the last one for sure; there is no queue for it."""
    listener = Listener(bench)
    for number in range(2000):
        bench.hear(ValuesChanged("garage", number & 0xFFFF, 0))
    last = list(channels_of(1999))
    while (listener.until("state")["value"].get("di") or {}).get("on") != last:
        pass
    assert len(bench.state()["happened"]) == 500
    listener.close()


def test_what_goes_wrong_is_told(bench: PanelBench) -> None:
    """A dead module, a line that is gone, a problem, the broker."""
    bench.hear(StationChanged("garage", online=False, detail="it is silent"))
    bench.hear(LineChanged("main", online=True, detail=""))
    bench.hear(LineChanged("main", online=False, detail="the port is gone"))
    bench.hear(ProblemChanged("main_02", "wrong_model", "a DIO100 answers"))
    bench.is_away = True
    bench.wait(lambda: bench.state()["state"]["bridge"]["broker"] == "away")
    state = bench.state()
    assert state["state"]["station/garage"]["online"] is False
    assert state["state"]["line/main"]["detail"] == "the port is gone"
    assert state["state"]["station/main_02"]["problem"]["reason"] == "wrong_model"
    told = [(one["kind"], one["where"]) for one in state["happened"]]
    assert told[-4:] == [
        ("station", "garage"),
        ("line", "main"),
        ("line", "main"),
        ("problem", "main_02"),
    ]


def test_a_new_module_is_known_with_its_first_word(bench: PanelBench) -> None:
    """After a reload its line tells of it at once: nothing of that is lost."""
    (line,) = bench.config.lines
    shed = replace(line.stations[0], id="shed", address=7)
    more = replace(bench.config, lines=(line, replace(line, id="other", stations=(shed,))))
    bench.current.replace(more)
    bench.panel.hear(LineChanged("other", online=True, detail=""))
    bench.panel.hear(StationChanged("shed", online=True, detail=""))
    state = bench.state()["state"]
    assert state["line/other"]["online"] is True
    assert state["station/shed"]["online"] is True
    assert [one["id"] for one in state["house"]["lines"]] == ["main", "other"]


def test_a_module_that_left_the_configuration_is_gone(bench: PanelBench) -> None:
    """Its last words do no harm."""
    (line,) = bench.config.lines
    fewer = replace(bench.config, lines=(replace(line, stations=line.stations[:1]),))
    bench.current.replace(fewer)
    bench.panel.hear(StationChanged("main_02", online=False, detail=""))
    assert "station/main_02" not in bench.state()["state"]


def test_verdicts_of_other_senders_are_shown_too(bench: PanelBench) -> None:
    """What was switched by MQTT happened as well."""
    bench.obeys = False
    commands: list[AnyCommand] = bench.line.commands
    bench.hub.submit(_command())
    bench.panel.hear(verdict_on(commands[-1], boot_s(), Status.DONE))
    last = bench.state()["happened"][-1]
    assert (last["kind"], last["status"], "by" in last) == ("verdict", "done", False)


def _command() -> AnyCommand:
    now = boot_s()
    return Command("garage", "do/1", "ON", 1, 1, None, arrived=now, deadline=now + 2)


def test_a_panel_that_ended_holds_up_nothing() -> None:
    """What is told to it later is lost: the main thread still has motors to stop."""
    with PanelBench() as bench:
        bench.wait(bench.state)
    bench.panel.hear(ValuesChanged("garage", 0b1, 0))
    bench.panel.hear(ValuesChanged("garage", 0b0, 0))
