"""`python -m panel.measures`: what the panel costs, and how fast it is beside MQTT.

House C of the benchmark: 31 modules on one line at 57600 baud. The machine should have nothing else
to do; each state is measured three times, those with and without browsers in turn.
"""

import http.client
import json
import os
import random
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from bench.cases import all_cases
from bench.daemon import MeasuredDaemon
from bench.figures import Spread, cycles
from bench.listener import Listener
from bench.wire import Wire
from support.mosquitto import Mosquitto, free_port

from bridge.cli.frame.locks import SCOPE_VARIABLE
from panel.browser import chromium, visitor

CASE = next(case for case in all_cases() if (case.letter, case.protocol) == ("C", "modbus-rtu"))
WATCHED_S = 20.0
ROUNDS = 3
COMMANDS, CHANGES = 100, 60
BROWSERS, MUTE = 20, 5
_ROW = "[aria-labelledby='station-l0-s{station}'] .terminals:not(.in) li:nth-child(8) .word"
_WATCH = """(selector) => {
  window.seen = [];
  new MutationObserver(() => window.seen.push(Date.now() / 1000))
    .observe(document.querySelector(selector), {childList: true, subtree: true});
}"""


@dataclass(frozen=True)
class Costs:
    """What was measured in one state of the bridge; times in ms."""

    name: str
    rss_mb: float
    cycle: tuple[float, float]
    verdict: tuple[float, float]

    @classmethod
    def middle(cls, rounds: "Sequence[Costs]") -> "Costs":
        """Return the middle of several rounds, figure by figure."""
        return cls(
            rounds[0].name,
            median(one.rss_mb for one in rounds),
            (median(one.cycle[0] for one in rounds), median(one.cycle[1] for one in rounds)),
            (median(one.verdict[0] for one in rounds), median(one.verdict[1] for one in rounds)),
        )

    def beside(self, before: "Costs") -> str:
        """Return how they compare with others."""
        pairs = (("command", self.verdict, before.verdict), ("cycle", self.cycle, before.cycle))
        shares = ", ".join(
            f"{word} p50 x {now[0] / then[0]:.3f}, p99 x {now[1] / then[1]:.3f}"
            for word, now, then in pairs
        )
        return f"{self.name} / {before.name}: {shares}, RSS {self.rss_mb - before.rss_mb:+.1f} MB"


class Bench:
    """The bridge on the line of the case."""

    def __init__(self, wire: Wire, listener: Listener, web: int, daemon: MeasuredDaemon) -> None:
        self.wire = wire
        self.listener = listener
        self.web = web
        self.daemon = daemon
        self._on = False
        self._number = 0

    def costs(self, name: str) -> "Costs":
        """Print memory, cycle, CPU, and how fast commands over MQTT are; return them."""
        self.wire.begin()
        self.daemon.begin()
        time.sleep(WATCHED_S)
        cycle, cpu = cycles(self.wire.take().reads, 0), self.daemon.cpu_percent()
        verdict = Spread.of(self._timed(self._by_mqtt))
        assert cycle is not None
        assert verdict is not None
        rss_mb = self.daemon.rss_mb()
        print(f"{name}: RSS {rss_mb:.1f} MB, CPU {cpu} %, cycle {cycle}")
        print(f"{name}: command to verdict by MQTT {verdict}", flush=True)
        return Costs(name, rss_mb, (cycle.p50, cycle.p99), (verdict.p50, verdict.p99))

    def presses(self) -> None:
        """Print how fast commands by the panel are, in turn with those by MQTT."""
        mqtt, panel = [], []
        for _ in range(COMMANDS):
            mqtt.append(self._by_mqtt())
            panel.append(self._by_panel())
        print(f"command to verdict in turn: MQTT {Spread.of(mqtt)}, panel {Spread.of(panel)}")

    def changes(self) -> None:
        """Print how long after its MQTT message a change is on a page in Chromium."""
        address = CASE.live[3]
        delays = []
        with chromium() as browser, visitor(browser, f"http://127.0.0.1:{self.web}/") as page:
            selector = _ROW.format(station=address)
            page.wait_for_selector(selector)
            page.wait_for_timeout(3000)
            page.evaluate(_WATCH, selector)
            for number in range(CHANGES):
                self.listener.begin()
                self.wire.switch(0, address, 8, number % 2 == 0)
                topic = f"bench/l0-s{address}/do/8"
                self.listener.wait_until({topic}.issubset, 10.0)
                at = next(when for when, name, _ in self.listener.heard() if name == topic)
                while page.evaluate("window.seen.length") <= number:
                    page.wait_for_timeout(20)
                wall = at - time.monotonic() + time.time()
                delays.append(page.evaluate(f"window.seen[{number}]") - wall)
                time.sleep(random.uniform(0.05, 0.2))  # noqa: S311  # no secret
        print(f"MQTT message to page: {Spread.of(delays)}", flush=True)

    def _timed(self, act: Callable[[], float]) -> Iterator[float]:
        for _ in range(COMMANDS):
            yield act()
            time.sleep(random.uniform(0.02, 0.08))  # noqa: S311  # no secret

    def _by_mqtt(self) -> float:
        self.listener.begin()
        self._number += 1
        mark = f'"id":"m{self._number}"'.encode()
        word = json.dumps({"state": self._word(), "id": f"m{self._number}"})
        began = self.listener.publish("bench/l0-s9/do/1/set", word)
        while True:
            for at, topic, payload in self.listener.heard():
                if topic == "bench/l0-s9/result" and mark in payload:
                    assert b'"done"' in payload, payload
                    return at - began
            time.sleep(0.001)

    def _by_panel(self) -> float:
        body = {"station": "l0-s9", "target": "do/1", "payload": self._word()}
        connection = http.client.HTTPConnection("127.0.0.1", self.web, timeout=10)
        began = time.monotonic()
        connection.request(
            "POST", "/api/command", json.dumps(body), {"Content-Type": "application/json"}
        )
        verdict: dict[str, Any] = json.loads(connection.getresponse().read())
        took_s = time.monotonic() - began
        connection.close()
        assert verdict["status"] == "done", verdict
        return took_s

    def _word(self) -> str:
        self._on = not self._on
        return "ON" if self._on else "OFF"


@contextmanager
def browsers(web: int) -> Iterator[None]:
    """So many that read, and some that never do."""
    with ExitStack() as stack:
        for number in range(BROWSERS + MUTE):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", web)))
            one.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            if number < BROWSERS:
                threading.Thread(target=_read, args=(one,), daemon=True).start()
        yield


def _read(one: socket.socket) -> None:
    try:
        while one.recv(65536):
            pass
    except OSError:
        pass  # it was closed: the measure is over


@contextmanager
def _bench(wire: Wire, broker: int, directory: Path, *, web: bool) -> Iterator[Bench]:
    port = free_port()
    path = directory / f"config{port}.yaml"
    text = CASE.config(wire.ports, broker, str(directory), plain=False)
    path.write_text(text + (f'web: {{listen: "127.0.0.1:{port}"}}\n' if web else ""))
    with Listener(broker) as listener, MeasuredDaemon(path) as daemon:
        listener.wait_online(CASE.live)
        print(f"all online {time.monotonic() - daemon.started_at:.2f} s after the start")
        time.sleep(5.0)
        yield Bench(wire, listener, port, daemon)


def _beside_browsers(bench: Bench, without: Costs) -> None:
    """Measure with browsers and without, in turn: the machine is not always the same."""
    alone, read = [], []
    for _ in range(ROUNDS):
        alone.append(bench.costs("with web"))
        with browsers(bench.web):
            time.sleep(1.0)
            read.append(bench.costs(f"with {BROWSERS} browsers and {MUTE} that never read"))
        time.sleep(1.0)
    print(Costs.middle(alone).beside(without))
    print(Costs.middle(read).beside(Costs.middle(alone)), flush=True)


def main() -> None:
    """Print all figures."""
    with ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="panel-")))
        os.environ[SCOPE_VARIABLE] = str(directory)  # another benchmark may run beside it
        broker = Mosquitto(directory / "broker", options=("max_queued_messages 0",))
        stack.callback(broker.stop)
        broker.start()
        wire = stack.enter_context(Wire([CASE.spec]))
        with _bench(wire, broker.port, directory, web=False) as bench:
            without = Costs.middle([bench.costs("without web") for _ in range(ROUNDS)])
        with _bench(wire, broker.port, directory, web=True) as bench:
            _beside_browsers(bench, without)
            bench.presses()
            bench.changes()


if __name__ == "__main__":
    main()
