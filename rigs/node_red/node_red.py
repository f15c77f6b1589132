"""A real Node-RED on a loopback port: started, given flows, clicked at and listened to."""

import http.client
import json
import os
import re
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pytest
from support.mosquitto import free_port

START_S = 60.0
_STARTED = re.compile(r"Started flows|Waiting for missing types")
# What a newcomer's own settings would say, without what asks the world outside for news.
_SETTINGS = """\
module.exports = {{
  uiHost: "127.0.0.1", uiPort: {port}, userDir: {directory}, flowFile: "flows.json",
  credentialSecret: "of a test", diagnostics: {{enabled: false}},
  telemetry: {{enabled: false, updateNotification: false}},
  externalModules: {{autoInstall: false, palette: {{allowInstall: false}}}},
  editorTheme: {{tours: false, projects: {{enabled: false}}, header: {{title: "Node-RED"}}}},
  mqttReconnectTime: 1000,
  logging: {{console: {{level: "info", metrics: false, audit: false}}}},
}};
"""


class NodeRed:
    """Node-RED as `make test-node-red` installed it. Use it with `with`.

    Attributes:
        port: Where its editor and its admin API listen.
    """

    def __init__(self, directory: Path) -> None:
        self.port = free_port()
        self._directory = directory
        self._log = directory / "node-red.log"
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self._directory.mkdir(exist_ok=True)
        settings = self._directory / "settings.js"
        directory = json.dumps(str(self._directory))
        settings.write_text(_SETTINGS.format(port=self.port, directory=directory))
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            print(f"Node-RED's log:\n{self.log}")  # pytest shows it beside the failure
        self.stop()

    def start(self) -> None:
        """Starts it, and returns when its flows run."""
        program = Path(os.environ["NODE_RED"]) / "node_modules" / "node-red" / "red.js"
        began = len(self.log)
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                ["node", str(program), "-s", str(self._directory / "settings.js")],
                cwd=self._directory,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        deadline = time.monotonic() + START_S
        while not _STARTED.search(self.log[began:]):
            if time.monotonic() > deadline or self._process.poll() is not None:
                pytest.fail(f"Node-RED did not start:\n{self.log}")
            time.sleep(0.05)  # a file tells nobody that it grew: it is looked at again

    def stop(self) -> None:
        """Ends it as an init system would. May be called twice."""
        process, self._process = self._process, None
        if process is not None:
            process.terminate()
            process.wait(START_S)

    @property
    def log(self) -> str:
        """Return its output so far."""
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    def deploy(self, flows: Sequence[dict[str, Any]]) -> None:
        """Does what the button Deploy does: everything else is gone."""
        status, answer = self._ask("POST", "/flows", flows, {"Node-RED-Deployment-Type": "full"})
        assert status == http.client.NO_CONTENT, answer

    def press(self, inject: str) -> None:
        """Presses the button of an inject node."""
        status, answer = self._ask("POST", f"/inject/{inject}")
        assert status == http.client.OK, answer

    def palette(self) -> set[str]:
        """Every type of node that it knows."""
        _, answer = self._ask("GET", "/nodes", headers={"Accept": "application/json"})
        return {name for module in json.loads(answer) for name in module["types"]}

    def _ask(
        self, method: str, path: str, body: object = None, headers: dict[str, str] | None = None
    ) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=START_S)
        try:
            document = None if body is None else json.dumps(body)
            kind = {"Content-Type": "application/json"}
            connection.request(method, path, document, {**kind, **(headers or {})})
            response = connection.getresponse()
            return response.status, response.read().decode()
        finally:
            connection.close()
