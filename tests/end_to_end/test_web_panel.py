"""The panel of the real daemon: beside MQTT, without a broker, and through a restart of its own."""

import http.client
import json
import time
from pathlib import Path
from typing import Any

from support.daemon import WAIT_S, Daemon
from support.mosquitto import free_port
from support.panel import BASE, house, panel, write_config

from bridge.model import LineProtocol


def _ask(port: int, method: str, path: str, body: object = None) -> Any:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_S)
    try:
        data = None if body is None else json.dumps(body)
        kind = {} if body is None else {"Content-Type": "application/json"}
        connection.request(method, path, data, kind)
        return json.loads(connection.getresponse().read())
    finally:
        connection.close()


def _when(port: int, path: str, condition: Any) -> Any:
    """Ask again until the answer is as wanted, and return it."""
    until = time.monotonic() + WAIT_S
    while True:
        try:
            answer = _ask(port, "GET", path)
        except OSError:
            answer = {}
        if answer and condition(answer):
            return answer
        assert time.monotonic() < until, answer
        time.sleep(0.05)


def _add_web(config: Path) -> int:
    port = free_port()
    config.write_text(f'web: {{listen: "127.0.0.1:{port}"}}\n{config.read_text()}')
    return port


def test_without_a_broker_the_panel_shows_and_switches(tmp_path: Path) -> None:
    """And the daemon ends as it does without one."""
    with panel(LineProtocol.WISCO) as line:
        config = write_config(tmp_path, line, free_port())
        port = _add_web(config)
        with Daemon(config) as daemon:
            daemon.wait_for_log("online: DO100")
            wish = {"station": "garage", "target": "do/3", "payload": "ON"}
            verdict = _ask(port, "POST", "/api/command", wish)
            state = _ask(port, "GET", "/api/state")["state"]
            status, _ = daemon.stop()
        assert (verdict["status"], verdict["by"]) == ("done", "panel")
        assert line.module(1).outputs == 0b100
        assert state["station/garage"]["do"]["on"] == [3]
        assert state["bridge"]["broker"] == "away"
        assert status == 0


def test_a_verdict_of_the_panel_is_on_mqtt_too(tmp_path: Path) -> None:
    """With `by: panel`; and a panel that is configured by a reload is there."""
    with house(tmp_path, LineProtocol.MODBUS_RTU) as running:
        port = free_port()
        running.reload("lines:", f'web: {{listen: "127.0.0.1:{port}"}}\nlines:')
        _when(port, "/api/state", lambda told: told["state"]["bridge"]["broker"] == "online")
        _when(port, "/api/state", lambda told: told["state"]["station/garage"]["online"])
        wish = {"station": "garage", "target": "do/3", "payload": "ON", "id": "web1"}
        assert _ask(port, "POST", "/api/command", wish)["status"] == "done"
        verdict = running.verdict("web1")
        assert verdict["by"] == "panel"
        assert any(
            (one.topic, one.payload) == (f"{BASE}/garage/do/3", b"ON") for one in running.probe.seen
        )


def test_a_configuration_that_moves_the_panel_is_followed(tmp_path: Path) -> None:
    """It is saved in the panel, which is then on another port; nothing is switched by it."""
    with panel(LineProtocol.WISCO) as line:
        config = write_config(tmp_path, line, free_port())
        port, other = _add_web(config), free_port()
        with Daemon(config) as daemon:
            daemon.wait_for_log("online: DO100")
            shown = _ask(port, "GET", "/api/config")
            text = shown["text"].replace(str(port), str(other))
            body = {"text": text, "version": shown["version"]}
            assert "version" in _ask(port, "PUT", "/api/config", body)
            _when(other, "/health", lambda told: told["status"] == "ok")
            _when(other, "/api/state", lambda told: told["state"]["station/garage"]["online"])
        assert config.with_name("config.yaml.before").exists()
        assert not any(line.module(address).switchings for address in (1, 2))
