"""docs/fleet in a real Prometheus: each query has an answer, each alert fires for its fault."""

import json
import re
import shutil
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from support.daemon import Daemon
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe

from fleet.house import BASE, House, house

DOCS = Path(__file__).parents[2] / "docs" / "fleet"
PATIENCE_S = 150.0  # figures of a line come once in 60 s, and a rate needs two of them
TOKEN = "only for looking"  # noqa: S105  # it opens nothing else

Tell = Callable[[str], None]


def queries() -> list[tuple[str, str]]:
    """Return title and query of each panel of the dashboard, as Grafana would send them."""
    panels = json.loads((DOCS / "grafana.json").read_text())["panels"]
    return [
        (panel["title"], target["expr"].replace("$site", ".*").replace("$__rate_interval", "3m"))
        for panel in panels
        for target in panel["targets"]
    ]


class Prometheus:
    """A Prometheus with our rules, which does not wait as long as they say."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/api/v1"

    def ask(self, query: str) -> list[dict[str, Any]]:
        """Return the answer to a query."""
        data = self._get(f"query?{urllib.parse.urlencode({'query': query})}")
        found: list[dict[str, Any]] = data["result"]
        return found

    def firing(self) -> set[str]:
        """Return the alerts that fire, each with the module or line that it names."""
        return {
            " ".join(filter(None, (one["labels"]["alertname"], _part(one["labels"]))))
            for one in self._get("alerts")["alerts"]
            if one["state"] == "firing"
        }

    def ready(self) -> bool:
        """Return whether it answers."""
        try:
            return bool(self._get("query?query=up")["result"])
        except (urllib.error.URLError, ConnectionError):
            return False

    def _get(self, path: str) -> dict[str, Any]:
        with urllib.request.urlopen(f"{self._url}/{path}", timeout=10) as answer:  # noqa: S310
            data: dict[str, Any] = json.load(answer)["data"]
        return data


def _part(labels: dict[str, str]) -> str:
    return labels.get("station") or labels.get("line") or ""


@contextmanager
def _prometheus(directory: Path, target: int) -> Iterator[Prometheus]:
    rules = re.sub(r"for: \d+m", "for: 1s", (DOCS / "alerts.yaml").read_text())
    (directory / "rules.yaml").write_text(rules)
    (directory / "token").write_text(TOKEN)
    scrape = (DOCS / "prometheus.yaml").read_text()
    for told, here in (
        ("/etc/prometheus/wisco2mqtt-alerts.yaml", f"{directory}/rules.yaml"),
        ("/etc/prometheus/wisco2mqtt.token", f"{directory}/token"),
        ("10.1.0.5:8099", f"127.0.0.1:{target}"),
        ("scrape_interval: 15s", "scrape_interval: 1s"),
    ):
        assert told in scrape
        scrape = scrape.replace(told, here)
    scrape = scrape[: scrape.index('      - targets: ["10.2')]  # there is one bridge here
    (directory / "prometheus.yaml").write_text(f"global: {{evaluation_interval: 1s}}\n{scrape}")
    port = free_port()
    program = shutil.which("prometheus")
    assert program is not None, "prometheus is not installed (Debian: apt install prometheus)"
    command = [
        program,
        f"--config.file={directory}/prometheus.yaml",
        f"--storage.tsdb.path={directory}/data",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    with (directory / "prometheus.log").open("wb") as log:
        process = subprocess.Popen(command, stderr=log)
        try:
            yield Prometheus(port)
        finally:
            process.kill()
            process.wait()


def run_alerts(directory: Path, tell: Tell) -> bool:
    """Run every query, then each fault until its alert fires and is over again."""
    broker, listens = Mosquitto(directory / "mosquitto"), free_port()
    with ExitStack() as stack:
        stack.callback(broker.stop)
        broker.start()
        built = stack.enter_context(house())
        config = directory / "config.yaml"
        text = built.configuration(f"host: 127.0.0.1, port: {broker.port}", f"{directory}")
        web = f"web: {{listen: 127.0.0.1:{listens}, read_token: {TOKEN}}}\n"
        config.write_text(web + text)
        daemon = stack.enter_context(Daemon(config))
        prometheus = stack.enter_context(_prometheus(directory, listens))
        _wait(prometheus.ready, "the first figures")
        with MqttProbe(broker.port, f"{BASE}/pumps/result") as probe:
            probe.publish(f"{BASE}/pumps/do/1/set", "ON")
            probe.wait_message(f"{BASE}/pumps/result")
        built.module("lamps").away = True  # so that there is something that does not answer
        for title, query in queries():
            _answers(prometheus, title, query, tell)
        built.module("lamps").away = False
        for alert, do, undo in _faults(built, broker, daemon):
            _fires(prometheus, alert, do, undo, tell)
    return True


def _answers(prometheus: Prometheus, title: str, query: str, tell: Tell) -> None:
    began = time.monotonic()
    _wait(lambda: bool(prometheus.ask(query)), f"an answer to {query}")
    found = prometheus.ask(query)
    tell(f"query  {title}: {len(found)} series, after {time.monotonic() - began:.0f} s")


Fault = tuple[str, Callable[[], object], Callable[[], object]]


def _faults(built: House, broker: Mosquitto, daemon: Daemon) -> Iterator[Fault]:
    module = built.module("pumps")
    yield (
        "Wisco2mqttModuleDown pumps",
        lambda: setattr(module, "away", True),
        lambda: setattr(module, "away", False),
    )
    yield "Wisco2mqttLineDown rtu", built.lines["rtu"].hang_up, built.lines["rtu"].restore
    yield "Wisco2mqttBrokerAway", broker.stop, broker.start
    yield "Wisco2mqttBridgeDown", daemon.process.kill, partial(ExitStack().enter_context, daemon)


def _fires(
    prometheus: Prometheus,
    alert: str,
    do: Callable[[], object],
    undo: Callable[[], object],
    tell: Tell,
) -> None:
    assert alert not in prometheus.firing()
    began = time.monotonic()
    do()
    _wait(lambda: alert in prometheus.firing(), f"alert {alert}")
    fired_s = time.monotonic() - began
    began = time.monotonic()
    undo()
    _wait(lambda: alert not in prometheus.firing(), f"the end of {alert}")
    tell(
        f"alert  {alert}: fires after {fired_s:.1f} s, over {time.monotonic() - began:.1f} s after"
    )


def _wait(holds: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < give_up, f"{what}: not within {PATIENCE_S:.0f} s"
        time.sleep(0.2)
