"""The messages of the debug sidebar of the editor, in order."""

import json
import threading
from dataclasses import dataclass
from typing import Any, Self

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

WAIT_S = 20.0  # generous: a wait ends as soon as its condition holds


@dataclass(frozen=True, slots=True)
class Shown:
    """One message of one debug node. An object is parsed."""

    node: str
    value: Any


class DebugSidebar:
    """Listens as the editor does, on the web socket `/comms`. Use it with `with`."""

    def __init__(self, port: int) -> None:
        self._url = f"ws://127.0.0.1:{port}/comms"
        self._changed = threading.Condition()
        self._shown: list[Shown] = []
        self._socket: ClientConnection | None = None
        self._thread = threading.Thread(target=self._listen, name="sidebar")

    def __enter__(self) -> Self:
        self._socket = connect(self._url)
        self._socket.send('{"subscribe":"debug"}')
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._socket is not None:
            self._socket.close()
            self._thread.join()

    def values(self, node: str) -> list[Any]:
        """Return the messages of one debug node so far, oldest first."""
        with self._changed:
            return [one.value for one in self._shown if one.node == node]

    def clear(self) -> None:
        """Forgets what was shown so far."""
        with self._changed:
            self._shown.clear()

    def wait_for(self, node: str, count: int = 1, timeout_s: float = WAIT_S) -> list[Any]:
        """Wait until one debug node has shown this many messages; return them."""
        with self._changed:
            enough = self._changed.wait_for(
                lambda: sum(one.node == node for one in self._shown) >= count, timeout_s
            )
            assert enough, f"{node} has not shown {count} messages: {self._shown}"
        return self.values(node)

    def _listen(self) -> None:
        assert self._socket is not None
        try:
            for text in self._socket:
                self._take(json.loads(text))
        except ConnectionClosed:
            return  # Node-RED ended, or we did

    def _take(self, messages: list[dict[str, Any]]) -> None:
        with self._changed:
            for message in messages:
                if message["topic"] == "debug":
                    self._shown.append(_shown(message["data"]))
            self._changed.notify_all()


def _shown(data: dict[str, Any]) -> Shown:
    is_object = data.get("format") == "Object"
    return Shown(data["id"], json.loads(data["msg"]) if is_object else data["msg"])
