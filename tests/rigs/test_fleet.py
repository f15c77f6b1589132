"""The rig of clusters: its plan, what it calls true, and the lines that docs/fleet.md shows."""

import json
import random
from pathlib import Path

from fleet.clusters import JOINED, NatsCluster
from fleet.house import BASE, STATIONS, House
from fleet.kills import plan

from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

DOCS = Path(__file__).parents[2] / "docs"


def _house() -> House:
    lines: dict[str, list[SimulatedModule]] = {}
    for line, address, model in STATIONS.values():
        lines.setdefault(line, []).append(SimulatedModule(model, address))
    return House(
        {name: SimulatedLine("modbus-rtu", 9600, modules) for name, modules in lines.items()}
    )


def _told(house: House) -> dict[str, bytes]:
    told = dict.fromkeys(house.topics(), b"OFF")
    told |= {topic: b"online" for topic in told if topic.endswith(("/state", "/availability"))}
    for station in STATIONS:
        model = house.module(station).model
        banks = {"di": model.inputs, "do": model.outputs}
        picture = {b: {str(n): "OFF" for n in range(1, most + 1)} for b, most in banks.items()}
        told[f"{BASE}/{station}"] = json.dumps(picture).encode()
    return told


def test_a_seed_makes_the_same_plan_again() -> None:
    """So what went wrong can be seen once more; at least as many are taken away as were asked."""
    made, again = (list(plan(random.Random(5), 200)) for _ in range(2))  # noqa: S311
    assert made == again
    assert sum(one.kills for one in made) >= 200
    assert {one.kind for one in made} == {"node", "frozen", "link", "majority", "all", "storm"}


def test_all_of_a_house_has_to_be_true() -> None:
    """One input that changed unseen, or one topic that is missing, is found."""
    house = _house()
    told = _told(house)
    assert house.untrue(told) is None
    house.module("gate").set_input(3, True)
    assert f"{BASE}/gate/di/3 is b'OFF'" in (house.untrue(told) or "")
    told[f"{BASE}/gate/di/3"] = b"ON"
    assert f"{BASE}/gate is" in (house.untrue(told) or "")
    del told[f"{BASE}/lamps/availability"]
    assert f"{BASE}/lamps/availability is None" in (house.untrue(told) or "")


def test_the_documents_show_what_the_rig_measures() -> None:
    """How mosquittos are joined, and the bridge with NATS, stands there as the rig does it."""
    shown = (DOCS / "fleet.md").read_text()
    for key in NatsCluster.more.removeprefix(", ").split(", "):
        assert f"\n  {key}\n" in shown
    for line in JOINED.splitlines():
        if not line.startswith("address"):
            assert f"\n{line}\n" in shown
