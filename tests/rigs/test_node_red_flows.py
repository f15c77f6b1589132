"""The example flows, checked without Node-RED."""

from pathlib import Path
from typing import Any

import pytest
from node_red.flows import FILES, Node, everything, read, wires

from bridge.mqtt.topics import CommandTarget, Topics

# Node-RED 4.1, @node-red/nodes/core: what the flows may be made of, nothing to be installed.
BUILT_IN = {"tab", "group", "subflow", "mqtt-broker", "mqtt in", "mqtt out", "inject", "debug"}
BUILT_IN |= {"function", "switch", "change", "trigger", "status", "comment"}
TOPICS = Topics("wisco")
PUBLISHED = {
    TOPICS.bridge_state,
    TOPICS.line_availability("main"),
    TOPICS.availability("garage"),
    TOPICS.channel("garage", "di", 1).replace("/1", "/+"),
}
every_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)


def test_there_are_flows() -> None:
    """The tests below cannot pass by finding nothing."""
    assert {path.name for path in FILES} >= {"inputs.json", "outputs.json", "alarm.json"}


@every_file
def test_a_flow_is_whole(path: Path) -> None:
    """Ids are there once, and every wire, tab, group and broker that a node names is there."""
    nodes = read(path)
    ids = [node["id"] for node in nodes]
    assert len(ids) == len(set(ids))
    for node in nodes:
        named = {
            node[key]
            for key in ("z", "g", "broker")
            if node["type"] != "mqtt-broker" and key in node
        }
        assert named | set(wires(node)) <= set(ids), node


@every_file
def test_a_flow_is_made_of_what_node_red_brings(path: Path) -> None:
    """A flow uses only nodes that Node-RED brings."""
    nodes = read(path)
    subflows = {f"subflow:{node['id']}" for node in nodes if node["type"] == "subflow"}
    assert {node["type"] for node in nodes} <= BUILT_IN | subflows


def test_the_files_share_one_node_of_the_broker() -> None:
    """Address and password are filled in once, however many of the files are imported."""
    brokers = [node for path in FILES for node in read(path) if node["type"] == "mqtt-broker"]
    assert brokers == [brokers[0]] * len(FILES)
    assert "credentials" not in brokers[0]


def test_what_is_listened_to_is_published() -> None:
    """Each topic stands in the code that publishes it."""
    topics = {node["topic"] for node in _of_type("mqtt in")}
    assert topics <= PUBLISHED | {"${RESULT}"}
    assert topics & PUBLISHED
    results = [item["value"] for item in _environment() if item["name"] == "RESULT"]
    assert results == ["${STATION}/result"]


def test_what_is_commanded_is_a_command() -> None:
    """A station and an output that a node of ours is set to make a topic that the bridge takes."""
    nodes = [node for node in everything() if node["type"].startswith("subflow:")]
    assert len(nodes) >= 3
    for node in nodes:
        setting = {item["name"]: item["value"] for item in node["env"]}
        for topic in (f"do/{setting['OUTPUT']}/set", "set"):
            assert isinstance(TOPICS.parse(f"{setting['STATION']}/{topic}"), CommandTarget)


def test_commands_are_sent_once() -> None:
    """QoS 0: Node-RED sends what is unacknowledged again after a reconnect, however old it is."""
    senders = _of_type("mqtt out")
    assert senders
    for node in senders:
        assert (node["qos"], node["retain"], node["expiry"]) == ("0", "false", "2")


def _of_type(name: str) -> list[Node]:
    return [node for node in everything() if node["type"] == name]


def _environment() -> list[dict[str, Any]]:
    return [item for node in _of_type("subflow") for item in node["env"]]
