"""A real Home Assistant in a process of its own, headless, on a loopback port."""

import json
import re
import shutil
import signal
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from home_assistant.guide import automations
from home_assistant.live import Live
from home_assistant.releases import Release
from support.mosquitto import free_port

START_S = 180.0  # the first start of a release compiles all of it
_STOP_S = 60.0
_HTTP_S = 30.0
_EVERY_S = 0.1  # a web server tells nobody that it is there: it is asked again
_CONFIGURATION = """\
homeassistant: {{name: Test, unit_system: metric, time_zone: UTC}}
http: {{server_host: 127.0.0.1, server_port: {port}}}
logger: {{default: warning}}
automation: !include automations.yaml
"""
# The step with the location would start integrations that want the internet.
_ONBOARDED = {"done": ["core_config", "analytics", "integration"]}


class HomeAssistant:
    """One instance of its own, with the automations of the guide.

    Use it with `with`; `restart` keeps what it knows.

    Attributes:
        url: Where its pages are.
        token: What lets a client in.
    """

    def __init__(self, release: Release) -> None:
        assert release.installed.exists(), f"Home Assistant {release.version}: make test-ha"
        self.release = release
        self._port = free_port()
        self.url = f"http://127.0.0.1:{self._port}"
        self.token = ""
        self._port_is_kept = False
        self._directory = self._make_directory()
        self._log = self._directory / "log"
        self._process: subprocess.Popen[bytes] | None = None
        self._live: Live | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            print(f"the log of Home Assistant:\n{self.log[-8000:]}")
        self.stop()
        shutil.rmtree(self._directory, ignore_errors=True)

    @property
    def live(self) -> Live:
        """The connection to its WebSocket API, and what it tells of states."""
        assert self._live is not None
        return self._live

    @property
    def log(self) -> str:
        """All that it said."""
        return self._log.read_text(errors="replace")

    def complaints(self) -> list[str]:
        """The warnings and errors of its MQTT component, and of anything that names it."""
        lines = re.findall(r"^.* (?:WARNING|ERROR|CRITICAL) .*$", self.log, re.MULTILINE)
        # That a busy computer is slow is no fault of an announcement: "Updating state ... took".
        return [line for line in lines if "mqtt" in line.lower() and "Updating state" not in line]

    def start(self) -> None:
        """Starts it, and returns when it is up and lets us in."""
        words = ["hass", "-c", self.release.inside(self._directory), "--log-no-color", "--skip-pip"]
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                self.release.command(*words),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LANG": "C.UTF-8"},
            )
        self._wait(lambda: self._ask("/manifest.json", None))
        if not self.token:
            self.token = self._onboard()
        self._wait(lambda: self._ask("/api/config", None)["state"] == "RUNNING")
        self._live = Live(f"ws://127.0.0.1:{self._port}/api/websocket", self.token)
        self._keep_the_port()

    def stop(self) -> None:
        """Ends it as an init system would."""
        if self._live is not None:
            self._live.close()
            self._live = None
        process, self._process = self._process, None
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def restart(self) -> None:
        """Stops it and starts it again: it knows what it knew."""
        self.stop()
        self.start()

    def add_broker(self, port: int) -> None:
        """Sets up its MQTT integration, as a user does in its dialogs."""
        flows = "/api/config/config_entries/flow"
        flow = self._ask(flows, {"handler": "mqtt", "show_advanced_options": False})
        answers: dict[str, Any] = {"broker": "127.0.0.1", "port": port}
        for field in flow["data_schema"]:
            if field.get("type") == "expandable":  # a section of newer releases
                answers[field["name"]] = {
                    "set_client_cert": False,
                    "set_ca_cert": "off",
                    "transport": "tcp",
                }
        made = self._ask(f"{flows}/{flow['flow_id']}", answers)
        assert made["type"] == "create_entry", made

    def _make_directory(self) -> Path:
        inside = self.release.root / "var/tmp" if self.release.suite is not None else None
        directory = Path(tempfile.mkdtemp(prefix="home-assistant-", dir=inside))
        (directory / "configuration.yaml").write_text(_CONFIGURATION.format(port=self._port))
        (directory / "automations.yaml").write_text(automations(newer=self.release.receives_events))
        storage = directory / ".storage"
        storage.mkdir()
        onboarding = {"version": 4, "minor_version": 1, "key": "onboarding", "data": _ONBOARDED}
        (storage / "onboarding").write_text(json.dumps(onboarding))
        return directory

    def _onboard(self) -> str:
        """Makes the first user, as the first visit in a browser does, and a token for it."""
        client = {"client_id": f"{self.url}/"}
        user = {"name": "Owner", "username": "owner", "password": "owner", "language": "en"}
        code = self._ask("/api/onboarding/users", {**client, **user})["auth_code"]
        grant = {**client, "grant_type": "authorization_code", "code": code}
        return str(self._ask("/auth/token", urllib.parse.urlencode(grant))["access_token"])

    def _keep_the_port(self) -> None:
        """Confirm the port: newer releases return to the default port without this."""
        if self.release.tries_ports and not self._port_is_kept:
            self.live.ask("http/config/promote")
            self._port_is_kept = True

    def _ask(self, path: str, body: dict[str, Any] | str | None) -> Any:
        """One HTTP request: a form where `body` is text, JSON where it is a dict."""
        request = urllib.request.Request(self.url + path)  # noqa: S310  # our own http://
        if self.token:
            request.add_header("Authorization", f"Bearer {self.token}")
        if body is not None:
            is_form = isinstance(body, str)
            kind = "x-www-form-urlencoded" if is_form else "json"
            request.add_header("Content-Type", f"application/{kind}")
            request.data = (body if isinstance(body, str) else json.dumps(body)).encode()
        with urllib.request.urlopen(request, timeout=_HTTP_S) as response:  # noqa: S310
            return json.load(response)

    def _wait(self, condition: Any) -> None:
        deadline = time.monotonic() + START_S
        while True:
            assert self._process is not None
            assert self._process.poll() is None, f"Home Assistant ended:\n{self.log[-3000:]}"
            try:
                if condition():
                    return
            except (OSError, urllib.error.URLError):
                pass
            assert time.monotonic() < deadline, f"not up after {START_S} s:\n{self.log[-3000:]}"
            time.sleep(_EVERY_S)
