"""Compares what is published with what the modules say themselves."""

import json
from collections.abc import Mapping

from soak.house import BASE, LINES, LIVE, Home, House


def what_is_untrue(states: Mapping[str, bytes], house: House) -> str | None:
    """Return the first thing that is offline or untrue, in words; None: everything is well."""
    availability = [f"{BASE}/bridge/state"]
    availability += [f"{BASE}/bridge/line/{line}/availability" for line in LINES]
    availability += [f"{BASE}/{home.id}/availability" for home in LIVE]
    for topic in availability:
        if states.get(topic) != b"online":
            return f"{topic} is {states.get(topic)!r}"
    for home in LIVE:
        published = states.get(f"{BASE}/{home.id}")
        if not _is_true(home, house, published or b"{}"):
            return f"{home.id} is published as {published!r}"
    return None


def _is_true(home: Home, house: House, published: bytes) -> bool:
    module, told = house.module(home), json.loads(published)
    truth = {
        "di": (home.model.inputs, module.inputs),
        "do": (home.model.outputs, module.outputs),
    }
    return all(
        told.get(bank) == {str(n + 1): "ON" if bits >> n & 1 else "OFF" for n in range(count)}
        for bank, (count, bits) in truth.items()
    )
