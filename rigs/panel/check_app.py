"""The app of Home Assistant from its options to a house: a stub Supervisor, and an ingress."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Browser, Page, expect
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe
from support.supervisor import TOKEN, supervisor

from bridge.config.load import load_config
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from panel.browser import terminal, visitor
from panel.clicks import set_up
from panel.house import PASSWORD, WITH_PORT
from panel.ingress import ingress

APP = Path(__file__).parents[2] / "packaging" / "home-assistant" / "wisco2mqtt"
USER, SECRET = "addons", "s3cret"
_STARTS_S, _STOPS_S = 15.0, 15.0
# The start script, where the container's folders, ingress and port are those of this machine.
_START = """\
import sys
from pathlib import Path
sys.path.insert(0, {app!r})
import start
text = start._CONFIG.replace("172.30.32.2", "127.0.0.1").replace("8099", "{web}")
start._CONFIG = text
start.main(Path({data!r}), Path({config!r}), {supervisor!r})
"""


@dataclass
class Container:
    """The folders of the app, and what is around it."""

    data: Path
    config: Path
    line: SimulatedLine
    supervisor: str
    web: int

    @contextmanager
    def started(self) -> Iterator[None]:
        """Start it, as the Supervisor does, and stop it at the end."""
        tools = self.data.parent / "bin"
        script = _START.format(
            app=str(APP),
            web=self.web,
            data=str(self.data),
            config=str(self.config),
            supervisor=self.supervisor,
        )
        path = f"{tools}:{os.environ['PATH']}"
        environ = {**os.environ, "SUPERVISOR_TOKEN": TOKEN, "PATH": path}
        with subprocess.Popen((sys.executable, "-c", script), env=environ) as process:
            try:
                self._wait_for_the_panel()
                yield
            finally:
                process.terminate()
                assert process.wait(_STOPS_S) == 0

    def _wait_for_the_panel(self) -> None:
        """Return when it listens: the watchdog of the app looks for just that."""
        deadline = time.monotonic() + _STARTS_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.web), 1).close()
            except ConnectionRefusedError:
                assert time.monotonic() < deadline
                time.sleep(0.05)  # a port tells nobody that it opens: it is tried again
            else:
                return


@contextmanager
def container(directory: Path) -> Iterator[tuple[Container, Mosquitto]]:
    """A container that was never started, with modules of which it knows nothing."""
    modules = [SimulatedModule(DIO100, 7), SimulatedModule(DO100, 12)]
    modules[0].set_mode(2, pulse=True, hold_s=0.5)
    data, tools = directory / "data", directory / "bin"
    for folder in (data, tools):
        folder.mkdir(parents=True)
    options = {"panel_password": PASSWORD, "log_level": "info"}
    (data / "options.json").write_text(json.dumps(options))
    broker = Mosquitto(directory / "broker", users={USER: SECRET})
    broker.start()
    told = {"host": "127.0.0.1", "port": broker.port, "username": USER, "password": SECRET}
    line = SimulatedLine(LineProtocol.MODBUS_RTU, 19200, modules)
    try:
        with line, supervisor(200, {"result": "ok", "data": {**told, "ssl": False}}) as url:
            program = tools / "wisco2mqtt"
            program.write_text(f"#!{sys.executable}\n{WITH_PORT.format(port=line.port)}")
            program.chmod(0o755)
            yield Container(data, directory / "config.yaml", line, url, free_port()), broker
    finally:
        broker.stop()


def test_from_the_options_to_a_house_a_restart_and_a_backup(
    browser: Browser, tmp_path: Path
) -> None:
    """The first start is an empty house; a restart switches nothing; a backup has all of it."""
    with container(tmp_path / "app") as (app, broker), ingress(app.web) as url:
        with app.started():
            _set_up(app, broker, browser, url)
        orders = [module.ordered.copy() for module in app.line.modules.values()]
        kept = app.config.read_text()
        assert SECRET not in kept
        assert PASSWORD not in kept
        with (
            app.started(),
            MqttProbe(broker.port, "wisco/#", username=USER, password=SECRET) as probe,
        ):
            probe.wait_message("wisco/garage/do/1", "ON")
            # As a backup does while it runs.
            backup = shutil.copy(app.config, tmp_path / "restored.yaml")
            shutil.copytree(app.data, tmp_path / "restored")
            with opened(browser, url) as page:
                expect(terminal(page, "Garage", "Lamp")).to_contain_text("ON")
        assert [module.ordered for module in app.line.modules.values()] == orders
        assert app.config.read_text() == kept
    secrets = ("WISCO_MQTT_USERNAME", "WISCO_MQTT_PASSWORD", "WISCO_PANEL_PASSWORD")
    restored = load_config(Path(backup), {**dict.fromkeys(secrets, "x"), "HOME": "/"})
    assert next(station.id for _, station in restored.all_stations) == "garage"
    assert (tmp_path / "restored" / "options.json").exists()


def _set_up(app: Container, broker: Mosquitto, browser: Browser, url: str) -> None:
    with (
        opened(browser, url) as page,
        MqttProbe(broker.port, "homeassistant/#", username=USER, password=SECRET) as probe,
    ):
        expect(page.get_by_role("article")).to_have_count(0)
        set_up(page, app.config, lambda _: None)
        probe.wait_for(lambda seen: any("wisco__garage" in one.topic for one in seen))
        page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
        expect(terminal(page, "Garage", "Lamp")).to_contain_text("done")
        assert app.line.module(7).outputs & 1


@contextmanager
def opened(browser: Browser, url: str) -> Iterator[Page]:
    """The panel through the ingress, with its password."""
    with visitor(browser, url) as page:
        page.get_by_label("Password").fill(PASSWORD)
        page.keyboard.press("Enter")
        expect(page.get_by_label("Password")).to_be_hidden()
        yield page
