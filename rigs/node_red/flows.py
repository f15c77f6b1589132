"""The example flows of docs/node-red/, as files and as Node-RED takes them."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / "docs" / "node-red"
FILES = tuple(sorted(FOLDER.glob("*.json")))

Node = dict[str, Any]


def read(path: Path) -> list[Node]:
    """The nodes of one file."""
    nodes: list[Node] = json.loads(path.read_text(encoding="utf-8"))
    return nodes


def everything() -> list[Node]:
    """All files imported into one Node-RED: what they share is there once."""
    return list({node["id"]: node for path in FILES for node in read(path)}.values())


def at_broker(nodes: Sequence[Node], port: int, **credentials: str) -> list[Node]:
    """The same with another port of the broker: all that a reader has to fill in."""
    login = {"credentials": credentials} if credentials else {}
    return [
        {**node, "broker": "127.0.0.1", "port": str(port), **login}
        if node["type"] == "mqtt-broker"
        else node
        for node in nodes
    ]


def wires(node: Node) -> Iterator[str]:
    """The ids that a node's wires lead to."""
    ports = node.get("wires", [])
    if node["type"] == "subflow":
        status = [node["status"]] if "status" in node else []
        ends = [*node["in"], *node["out"], *status]
        yield from (wire["id"] for end in ends for wire in end["wires"])
        return
    yield from (target for port in ports for target in port)
