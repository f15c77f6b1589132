"""`max_on` through frames, a real mosquitto and the real daemon."""

import time
from pathlib import Path

from support.mqtt_probe import Seen
from support.panel import BASE, house, results

from bridge.model import LineProtocol


def _is_off_by_max_on(seen: list[Seen]) -> bool:
    return any(verdict.get("by") == "max_on" for verdict in results(seen))


def test_an_output_is_on_for_as_long_as_max_on_allows(tmp_path: Path) -> None:
    """Switched ON by a hand: one OFF on the wire, its state, and a line on the result topic."""
    with house(tmp_path, LineProtocol.WISCO, garage="outputs: {3: {max_on: 2s}}") as running:
        began = time.monotonic()
        running.line.module(1).set_output(3, True)
        running.probe.wait_message(f"{BASE}/garage/do/3", "ON")
        seen = running.probe.wait_for(_is_off_by_max_on)
        running.command("garage/do/4/set", {"state": "ON"})
        assert "do/3 OFF by max_on (it was ON for 2 s): done" in running.daemon.log
        first, second = running.orders()
    topics = [message.topic for message in seen]
    assert topics.index(f"{BASE}/garage/result") > topics.index(f"{BASE}/garage/do/3")
    assert (first.output, first.value) == (3, False)
    assert 2.0 <= first.at - began <= 2.0 + 2.0 + 1.0  # and what a sweep of the outputs takes
    assert (second.output, second.value) == (4, True)
