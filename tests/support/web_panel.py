"""The panel of the browser in this process, with a hub before a fake line, asked over HTTP."""

import http.client
import json
import queue
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Self

from support.fake_worker import FakeWorker
from support.house import make_config
from support.mosquitto import free_port

from bridge.clock import boot_s
from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, WebConfig
from bridge.daemon.wiring import wall_clock
from bridge.hub.counts import Counts
from bridge.hub.hub import Hub
from bridge.model import AnyCommand, MainWork, PublicEvent, StationChanged, Status, verdict_on
from bridge.mqtt.requests import Reply
from bridge.web.config_file import ConfigFile
from bridge.web.panel import PanelTies, WebPanel

WAIT_S = 20.0


@dataclass(frozen=True)
class WebAnswer:
    """What the panel answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def document(self) -> Any:
        """Return the JSON in it."""
        return json.loads(self.body)


class PanelBench:
    """A panel that listens on loopback. Use it with `with`; the test is the main thread.

    Attributes:
        line: What takes the commands.
        reloads: How often a reload was asked for.
        traces: The lines that were to be traced, and for how long.
        requests: What was asked of the bridge by the panel.
        answer: What it is answered.
        obeys: Whether each command is `done` at once.
        stuck_s: For how long the main thread gives no sign of life.
    """

    def __init__(
        self,
        web: WebConfig | None = None,
        *,
        config: Config | None = None,
        file: ConfigFile | None = None,
    ) -> None:
        self.web = replace(web or WebConfig(), port=free_port())
        self.config = replace(config or make_config(), web=self.web)
        self.line = FakeWorker(self.config.lines[0])
        self.reloads = 0
        self.traces: list[tuple[str, float]] = []
        self.requests: list[tuple[str, Mapping[str, Any]]] = []
        self.answer: Mapping[str, Any] = {"status": "ok", "data": {}}
        self.obeys = True
        self.is_away = False
        self.stuck_s = 0.0
        self.current = CurrentConfig(self.config)
        self._work: queue.Queue[MainWork] = queue.Queue()
        self.panel = WebPanel(self.web, self._work.put, wall_clock, file)
        counts = Counts(self.current, self.panel.hear)
        lines = {"main": self.line}
        self.hub = Hub(self.current, self.panel.hear, lines, counts, boot_s)

    def __enter__(self) -> Self:
        self.panel.start(
            PanelTies(
                self.current,
                self._submit,
                self._reload,
                self._trace,
                self._asked,
                lambda _: self.is_away,
            )
        )
        for station_id in self.current.stations:
            self.hear(StationChanged(station_id, online=True, detail=""))
        self.wait(self._listens)
        return self

    def __exit__(self, *_: object) -> None:
        self.panel.stop()

    def hear(self, event: PublicEvent) -> None:
        """Let the hub hear of something, as from a line."""
        self.hub.apply(event)  # type: ignore[arg-type]  # counts come another way

    def pump(self) -> None:
        """Do what the panel handed over to the main thread."""
        while not self._work.empty():
            self._work.get().do()

    def wait(self, condition: Callable[[], Any]) -> None:
        """Work as the main thread does until something holds."""
        until = boot_s() + WAIT_S
        tick = threading.Event()
        while not condition():
            assert boot_s() < until
            self.pump()
            self.panel.tick(boot_s() - self.stuck_s)
            tick.wait(0.005)

    def ask(
        self,
        method: str,
        path: str,
        body: object = None,
        headers: Mapping[str, str] | None = None,
    ) -> WebAnswer:
        """Ask the panel, while the main thread works. `body` is sent as JSON, or as it is."""
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(self._ask, method, path, body, headers or {})
            self.wait(asked.done)
        return asked.result()

    def command(self, station_id: str, target: str, payload: object, **more: object) -> WebAnswer:
        """Send a command."""
        body = {"station": station_id, "target": target, "payload": payload, **more}
        return self.ask("POST", "/api/command", body)

    def state(self) -> Any:
        """Return what `GET /api/state` tells."""
        return self.ask("GET", "/api/state").document

    def _ask(self, method: str, path: str, body: object, headers: Mapping[str, str]) -> WebAnswer:
        connection = http.client.HTTPConnection("127.0.0.1", self.web.port, timeout=WAIT_S)
        try:
            data = body if isinstance(body, bytes) else json.dumps(body).encode()
            kind = {} if body is None else {"Content-Type": "application/json"}
            if method != "GET" and body is None:
                data, kind = b"{}", {"Content-Type": "application/json"}
            sent = None if method == "GET" and body is None else data
            connection.request(method, path, sent, {**kind, **headers})
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            return WebAnswer(answer.status, found, answer.read())
        finally:
            connection.close()

    def _listens(self) -> bool:
        try:
            self._ask("GET", "/", None, {})
        except OSError:
            return False
        return True

    def _submit(self, command: AnyCommand) -> None:
        taken = len(self.line.commands)
        self.hub.submit(command)
        if self.obeys and self.line.commands[taken:]:
            self.panel.hear(verdict_on(command, boot_s(), Status.DONE))

    def _trace(self, line: str, for_s: float) -> None:
        self.traces.append((line, for_s))

    def _asked(self, verb: str, arguments: Mapping[str, Any], reply: Reply) -> None:
        self.requests.append((verb, arguments))
        reply({"status": "ok", "data": {"progress": 0.5, "final": False}})
        reply(self.answer)

    def _reload(self) -> None:
        self.reloads += 1
