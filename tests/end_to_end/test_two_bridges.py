"""Two bridges on one broker, one's base topic below the other's: neither touches the other."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from support.brokers import Broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, held_at, wait_for_held
from support.panel import broker

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

HOUSE, ATTIC = "house", "house/attic"
STATIONS = "{address: 1, model: DIO100, id: garage}", "{address: 2, model: DO100, id: pumps}"


@contextmanager
def bridge(
    directory: Path, base: str, broker_port: int, *stations: str
) -> Iterator[tuple[SimulatedLine, Daemon]]:
    """A bridge with a line of its own; both have the same station ids."""
    directory.mkdir(exist_ok=True)
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    with SimulatedLine(LineProtocol.MODBUS_RTU, 19200, modules) as line:
        config = directory / "config.yaml"
        config.write_text(
            f"mqtt: {{host: 127.0.0.1, port: {broker_port}, base_topic: {base}}}\n"
            f"state_dir: {directory}\n"
            f"lines: [{{id: main, port: {line.port}, baud: 19200, protocol: modbus-rtu, "
            f"stations: [{', '.join(stations)}]}}]\n"
        )
        with Daemon(config) as daemon:
            yield line, daemon


def of_bridge(held: dict[str, str], base: str) -> dict[str, str]:
    """Return the retained topics of one bridge, without diagnostics."""
    other = f"{ATTIC}/" if base == HOUSE else None
    node = f"/{base.replace('/', '__')}__"
    found = {}
    for topic, payload in held.items():
        states = topic.startswith(f"{base}/") and not (other and topic.startswith(other))
        announced = node in topic and not (other and "/house__attic__" in topic)
        if (states or announced) and "diagnostics" not in topic:
            found[topic] = payload
    return found


def has_pumps(held: dict[str, str]) -> bool:
    """Return whether a topic of the second station of the house is retained."""
    return any("pumps" in topic for topic in of_bridge(held, HOUSE))


def wait_online(probe: MqttProbe, base: str) -> None:
    """Waits until a bridge and both of its stations are online."""
    for topic in ("bridge/state", "garage/availability", "pumps/availability"):
        probe.wait_message(f"{base}/{topic}", "online")


@contextmanager
def both(directory: Path, mosquitto: Broker) -> Iterator[tuple[SimulatedLine, SimulatedLine]]:
    """The lines of the house and of the attic, whose bridges are online."""
    with ExitStack() as stack:
        lines = [
            stack.enter_context(
                bridge(directory / base.replace("/", "_"), base, mosquitto.port, *STATIONS)
            )[0]
            for base in (HOUSE, ATTIC)
        ]
        yield lines[0], lines[1]


def test_a_command_reaches_the_bridge_that_it_names(tmp_path: Path) -> None:
    """With the same station id at two bridges, one relay moves and one verdict comes."""
    with (
        broker(tmp_path) as mosquitto,
        MqttProbe(mosquitto.port, "#") as probe,
        both(tmp_path, mosquitto) as (house, attic),
    ):
        wait_online(probe, HOUSE)
        wait_online(probe, ATTIC)
        probe.publish(f"{ATTIC}/pumps/do/3/set", "ON")
        probe.wait_message(f"{ATTIC}/pumps/do/3", "ON")
        verdict = json.loads(probe.wait_message(f"{ATTIC}/pumps/result").payload)
        assert (verdict["target"], verdict["status"]) == ("do/3", "done")
        assert attic.module(2).outputs == 0b100
        assert house.module(2).outputs == 0
        assert not [m for m in probe.seen if m.topic == f"{HOUSE}/pumps/result"]


def test_what_one_bridge_clears_is_its_own(tmp_path: Path) -> None:
    """A station is taken from the house: that of the attic with the same id stays, in all."""
    filters = (f"{HOUSE}/#", "homeassistant/#")
    with (
        broker(tmp_path) as mosquitto,
        MqttProbe(mosquitto.port, *filters) as probe,
        ExitStack() as run,
    ):
        run.enter_context(bridge(tmp_path / "attic", ATTIC, mosquitto.port, *STATIONS))
        wait_online(probe, ATTIC)
        with bridge(tmp_path / "house", HOUSE, mosquitto.port, *STATIONS) as (_, daemon):
            wait_online(probe, HOUSE)
            daemon.stop()
        held = held_at(mosquitto.port, *filters)
        before = of_bridge(held, ATTIC)
        assert [topic for topic in before if topic.startswith("homeassistant/")]
        assert has_pumps(held)
        with bridge(tmp_path / "house", HOUSE, mosquitto.port, STATIONS[0]):
            held = wait_for_held(mosquitto.port, filters, lambda held: not has_pumps(held))
            assert of_bridge(held, ATTIC) == before
