"""`make test-node-red`: the example flows in a real Node-RED, down to the simulated relay.

Node-RED, mosquitto, the daemon and the modules are all there. What counts is what the module was
ordered to do, and what the debug sidebar shows.
"""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.brokers import Broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, write_config
from support.tcp_relay import TcpRelay

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine
from node_red.debug_sidebar import DebugSidebar
from node_red.flows import FOLDER, at_broker, everything, read
from node_red.node_red import NodeRed

pytestmark = pytest.mark.timeout(180)

HOLD_S = 0.5
PATIENCE_S = 10.0  # of the flow, before it raises an alarm
VERDICT_S = 6.0  # of the flow, before it gives up
DOOR, OTHERS, ALARM = "wisco-inputs-door", "wisco-inputs-others", "wisco-alarm-told"
OPENED, CLOSED = "the door was opened", "the door was closed"


class House:
    """Everything that runs.

    Attributes:
        garage, pumps: The simulated modules, a DIO100 with a pulse output 2, and a DO100.
        orders: What the modules were ordered: station, output, value.
    """

    def __init__(
        self, directory: Path, line: SimulatedLine, mosquitto: Broker, node_red: NodeRed
    ) -> None:
        self.line = line
        self.mosquitto = mosquitto
        self.node_red = node_red
        self.garage = line.module(1)
        self.pumps = line.module(2)
        self.config = write_config(directory, line, mosquitto.port)

    @property
    def orders(self) -> int:
        """Return the number of orders of any kind so far."""
        return sum(self.garage.ordered.values()) + sum(self.pumps.ordered.values())

    @contextmanager
    def bridge(self) -> Iterator[Daemon]:
        """The daemon, from when all that it has to tell is told."""
        with MqttProbe(self.mosquitto.port, f"{BASE}/#") as probe, Daemon(self.config) as daemon:
            probe.wait_for(is_complete)
            yield daemon
            daemon.stop()

    @contextmanager
    def flows(self, name: str, port: int | None = None) -> Iterator[DebugSidebar]:
        """One file imported and deployed, and what it shows from then on."""
        nodes = read(FOLDER / name)
        with DebugSidebar(self.node_red.port) as sidebar:
            began = self.node_red.log.count("Connected to broker")
            self.node_red.deploy(at_broker(nodes, port or self.mosquitto.port))
            _wait(lambda: self.node_red.log.count("Connected to broker") > began)
            yield sidebar


def _wait(condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.02)  # counters and files tell nobody: they are looked at again


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """One house for all: each test leaves it as it found it."""
    directory = tmp_path_factory.mktemp("house")
    with (
        panel(LineProtocol.WISCO) as line,
        broker(directory) as mosquitto,
        NodeRed(directory / "node-red") as node_red,
    ):
        line.module(1).set_mode(2, pulse=True, hold_s=HOLD_S)
        yield House(directory, line, mosquitto, node_red)


@pytest.fixture(autouse=True)
def _as_it_was(house: House) -> Iterator[None]:
    yield
    house.node_red.deploy([])
    for module in (house.garage, house.pumps):
        module.away = False
        for output in range(1, module.model.outputs + 1):
            module.set_output(output, value=False)
    for channel in range(1, 17):
        house.garage.set_input(channel, value=False)


def test_node_red_knows_every_node_of_the_flows(house: House) -> None:
    """Nothing has to be installed beside Node-RED itself."""
    used = {node["type"] for node in everything()}
    built_in = {"tab", "subflow", "group", *(f"subflow:{node['id']}" for node in everything())}
    assert used - built_in <= house.node_red.palette()


def test_all_files_together_run_without_a_complaint(house: House) -> None:
    """All flows together share the node of the broker, and cause no warning."""
    before = house.orders
    with house.bridge() as daemon, DebugSidebar(house.node_red.port) as sidebar:
        began = len(house.node_red.log)
        house.node_red.deploy(at_broker(everything(), house.mosquitto.port))
        _wait(lambda: "Connected to broker" in house.node_red.log[began:])
        house.node_red.press("wisco-outputs-lamp-on")
        assert sidebar.wait_for("wisco-outputs-lamp-done")[0]["status"] == "done"
        assert house.orders == before + 1
        said = house.node_red.log[began:]
        assert "[warn]" not in said
        assert "[error]" not in said
        assert "WARNING bridge.mqtt" not in daemon.log


# --- inputs -----------------------------------------------------------------------------------


def test_each_change_of_an_input_is_told_once(house: House) -> None:
    """Door and other inputs, in their order; what was so at the start is no change."""
    house.garage.set_input(5, value=True)
    with house.bridge(), house.flows("inputs.json") as sidebar:
        _wait_until_trusted(house, sidebar)
        for count in range(1, 11):
            house.garage.set_input(1, value=True)
            sidebar.wait_for(DOOR, 2 * count - 1)
            house.garage.set_input(1, value=False)
            sidebar.wait_for(DOOR, 2 * count)
        assert sidebar.values(DOOR) == [OPENED, CLOSED] * 10
        house.garage.set_input(5, value=False)
        assert _told(sidebar.wait_for(OTHERS)) == [("wisco/garage/di/5", "OFF")]


def _wait_until_trusted(house: House, sidebar: DebugSidebar) -> None:
    """Turns input 16 until the flow tells of it: it has heard all that is retained then."""
    deadline = time.monotonic() + 20
    while not sidebar.values(OTHERS):
        assert time.monotonic() < deadline, "no input is told"
        house.garage.toggle_input(16)
        time.sleep(0.3)  # longer than a poll, or nothing would be seen of it
    house.garage.set_input(16, value=False)
    time.sleep(0.5)
    sidebar.clear()


def _told(messages: list[dict[str, Any]]) -> list[tuple[str, str]]:
    return [(message["topic"], message["payload"]) for message in messages]


def test_an_input_that_changes_while_its_module_is_away_is_told_when_it_is_back(
    house: House,
) -> None:
    """Nothing is told while nothing is known, and one change then."""
    availability = f"{BASE}/garage/availability"
    with house.bridge(), house.flows("inputs.json") as sidebar:
        _wait_until_trusted(house, sidebar)
        with MqttProbe(house.mosquitto.port, availability) as probe:
            house.garage.away = True
            probe.wait_message(availability, "offline")
            house.garage.set_input(1, value=True)
            house.garage.away = False
            assert sidebar.wait_for(DOOR) == [OPENED]


def test_a_restart_of_the_bridge_is_no_change_of_an_input(house: House) -> None:
    """All is published again, and nothing is told but what really changed."""
    with house.flows("inputs.json") as sidebar:
        with house.bridge():
            _wait_until_trusted(house, sidebar)
        house.garage.set_input(1, value=True)  # while nobody looks
        with house.bridge():
            sidebar.wait_for(DOOR)
            house.garage.set_input(1, value=False)
            sidebar.wait_for(DOOR, 2)
        assert sidebar.values(DOOR) == [OPENED, CLOSED]
        assert not sidebar.values(OTHERS)


# --- outputs ----------------------------------------------------------------------------------


def test_a_button_switches_the_relay_once_and_shows_the_verdict(house: House) -> None:
    """ON, TOGGLE, ON, OFF: one order each, and the module is as it was told."""
    presses = (("on", "ON", 1), ("toggle", "TOGGLE", 0), ("on", "ON", 1), ("off", "OFF", 0))
    with house.bridge(), house.flows("outputs.json") as sidebar:
        before = house.orders
        for count, (button, word, outputs) in enumerate(presses, start=1):
            house.node_red.press(f"wisco-outputs-lamp-{button}")
            verdict = sidebar.wait_for("wisco-outputs-lamp-done", count)[-1]
            assert (verdict["target"], verdict["payload"]) == ("do/1", word)
            assert house.garage.outputs == outputs
            assert house.orders == before + count
        assert not sidebar.values("wisco-outputs-lamp-not-done")


def test_several_outputs_are_one_write(house: House) -> None:
    """One frame for all of them, and one verdict."""
    with house.bridge(), house.flows("outputs.json") as sidebar:
        began = len(house.pumps.switchings)
        house.node_red.press("wisco-outputs-several-some")
        verdict = sidebar.wait_for("wisco-outputs-several-done")[0]
        assert verdict["payload"] == {"1": "ON", "4": "ON", "16": "OFF"}
        ordered = list(house.pumps.switchings)[began:]
        # A Modbus write covers the gaps too, with the values that they have.
        assert [(one.output, one.value) for one in ordered if one.changed] == [(1, True), (4, True)]
        assert len({(one.at, one.frame) for one in ordered}) == 1
        house.node_red.press("wisco-outputs-several-none")
        sidebar.wait_for("wisco-outputs-several-done", 2)
        assert house.pumps.outputs == 0


def test_a_pulse_is_ordered_once_and_ends_by_itself(house: House) -> None:
    """One order for each press, and the verdict says whether it was seen ON."""
    with house.bridge(), house.flows("outputs.json") as sidebar:
        for count in range(1, 4):
            before = house.garage.ordered[2, True]
            house.node_red.press("wisco-outputs-gate-press")
            verdict = sidebar.wait_for("wisco-outputs-gate-done", count)[-1]
            assert (verdict["status"], verdict["seen_on"]) == ("done", True)
            assert house.garage.ordered[2, True] == before + 1
            _wait(lambda: house.garage.outputs == 0)
        assert house.garage.ordered[2, False] == 0


def test_verdicts_of_others_are_not_taken_for_ours(house: House) -> None:
    """A verdict on the command of another client shows nothing here."""
    with house.bridge(), house.flows("outputs.json") as sidebar:
        with MqttProbe(house.mosquitto.port, f"{BASE}/garage/result") as other:
            other.publish(f"{BASE}/garage/do/1/set", '{"state": "OFF", "id": "of another"}')
            other.wait_message(f"{BASE}/garage/result")
        house.node_red.press("wisco-outputs-lamp-off")
        assert len(sidebar.wait_for("wisco-outputs-lamp-done")) == 1


def test_what_is_not_done_comes_out_below(house: House) -> None:
    """A module that is away refuses with `offline`, and orders nothing."""
    with house.bridge(), house.flows("outputs.json") as sidebar:
        availability = f"{BASE}/garage/availability"
        with MqttProbe(house.mosquitto.port, availability) as probe:
            house.garage.away = True
            probe.wait_message(availability, "offline")
        before = house.orders
        house.node_red.press("wisco-outputs-lamp-on")
        verdict = sidebar.wait_for("wisco-outputs-lamp-not-done")[0]
        assert (verdict["status"], verdict["reason"]) == ("refused", "offline")
        assert house.orders == before


def _works_again(house: House, sidebar: DebugSidebar) -> None:
    """Return whether a new command works; everything queued comes before it."""
    sidebar.clear()
    house.node_red.press("wisco-outputs-gate-press")
    assert sidebar.wait_for("wisco-outputs-gate-done")[0]["status"] == "done"


def test_a_command_that_nobody_answers_is_unknown_and_never_comes_late(house: House) -> None:
    """A command without an answer is `unknown` after 6 s, and is never carried out later."""
    before = house.orders
    with house.flows("outputs.json") as sidebar:
        for count in (1, 2):
            began = time.monotonic()
            house.node_red.press("wisco-outputs-gate-press")
            verdict = sidebar.wait_for("wisco-outputs-gate-not-done", count)[-1]
            assert (verdict["status"], verdict["reason"]) == ("unknown", "no_verdict")
            assert time.monotonic() - began >= VERDICT_S
            house.mosquitto.stop()
        connected = house.node_red.log.count("Connected to broker")
        house.mosquitto.start()
        _wait(lambda: house.node_red.log.count("Connected to broker") > connected)
        with house.bridge():
            _works_again(house, sidebar)
    assert house.orders == before + 1


def test_a_link_that_hangs_and_breaks_sends_no_command_again(house: House) -> None:
    """A message that Node-RED could not send is not sent over its next connection."""
    with (
        TcpRelay(house.mosquitto.port) as relay,
        house.bridge(),
        house.flows("outputs.json", relay.port) as sidebar,
    ):
        before = house.orders
        relay.stall()
        house.node_red.press("wisco-outputs-gate-press")
        verdict = sidebar.wait_for("wisco-outputs-gate-not-done")[0]
        assert verdict["reason"] == "no_verdict"
        connected = house.node_red.log.count("Connected to broker")
        relay.cut()
        relay.resume()
        _wait(lambda: house.node_red.log.count("Connected to broker") > connected)
        _works_again(house, sidebar)
        assert house.orders == before + 1


def test_a_restart_of_node_red_or_of_the_broker_orders_nothing(house: House) -> None:
    """Nothing is sent at a start: buttons are pressed by people."""
    with house.bridge():
        with house.flows("outputs.json"):
            before = house.orders
            connected = house.node_red.log.count("Connected to broker")
            house.mosquitto.restart()
            _wait(lambda: house.node_red.log.count("Connected to broker") > connected)
        house.node_red.deploy(at_broker(everything(), house.mosquitto.port))
        house.node_red.stop()
        connected = house.node_red.log.count("Connected to broker")
        house.node_red.start()
        _wait(lambda: house.node_red.log.count("Connected to broker") > connected)
        with DebugSidebar(house.node_red.port) as sidebar:
            house.node_red.press("wisco-outputs-lamp-on")
            sidebar.wait_for("wisco-outputs-lamp-done")
        assert house.orders == before + 1


# --- alarm ------------------------------------------------------------------------------------


def test_the_alarm_names_the_module_that_is_away_and_tells_when_it_is_back(house: House) -> None:
    """Once each, the alarm after its patience."""
    with house.bridge(), house.flows("alarm.json") as sidebar:
        house.garage.away = True
        began = time.monotonic()
        assert sidebar.wait_for(ALARM)[0] == "garage is unavailable: the module does not answer"
        assert time.monotonic() - began >= PATIENCE_S
        house.garage.away = False
        assert sidebar.wait_for(ALARM, 2, 40.0)[1] == "garage is available again"
        assert len(sidebar.values(ALARM)) == 2


def test_the_alarm_names_the_port_that_is_gone(house: House) -> None:
    """The line's availability is part of the truth."""
    with house.bridge(), house.flows("alarm.json") as sidebar:
        house.line.hang_up()
        text = "garage is unavailable: the port of the line main is gone"
        assert sidebar.wait_for(ALARM)[0] == text
        house.line.restore()
        assert sidebar.wait_for(ALARM, 2, 40.0)[1] == "garage is available again"


def test_the_alarm_names_the_bridge_that_was_killed(house: House) -> None:
    """After a kill of the bridge its last will is enough for the alarm."""
    with house.flows("alarm.json") as sidebar:
        with house.bridge() as daemon:
            daemon.signal(signal.SIGKILL)
            daemon.process.wait(20)
            assert sidebar.wait_for(ALARM)[0] == "garage is unavailable: the bridge is offline"
        with house.bridge():
            assert sidebar.wait_for(ALARM, 2)[1] == "garage is available again"


def test_the_alarm_names_the_broker_that_is_away(house: House) -> None:
    """The alarm names a broker that is away."""
    with house.bridge(), house.flows("alarm.json") as sidebar:
        house.mosquitto.stop()
        assert sidebar.wait_for(ALARM)[0] == "garage is unavailable: the broker is away"
        house.mosquitto.start()
        assert sidebar.wait_for(ALARM, 2, 40.0)[1] == "garage is available again"


def test_a_short_absence_is_no_alarm(house: House) -> None:
    """A bridge that is started again is back long before."""
    with house.flows("alarm.json") as sidebar:
        with house.bridge():
            pass
        with house.bridge():
            time.sleep(PATIENCE_S + 1)  # longer than an alarm would take to come
        assert not sidebar.values(ALARM)
