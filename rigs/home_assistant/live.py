"""Home Assistant's WebSocket API: commands, registries, and every change of a state as it comes."""

import json
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import count
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

WAIT_S = 60.0  # generous: a wait ends as soon as its condition holds
_ANSWER_S = 30.0


@dataclass(frozen=True, slots=True)
class Change:
    """A new state of an entity. `state` None: the entity is gone. `at` is monotonic."""

    at: float
    state: str | None
    attributes: dict[str, Any]


class Live:
    """A connection that follows all states. Its reader is a thread; one lock guards the rest."""

    def __init__(self, url: str, token: str) -> None:
        self._socket = connect(url, max_size=None, proxy=None)
        assert json.loads(self._socket.recv())["type"] == "auth_required"
        self._socket.send(json.dumps({"type": "auth", "access_token": token}))
        assert json.loads(self._socket.recv())["type"] == "auth_ok"
        self._numbers = count(1)
        self._answers: dict[int, dict[str, Any]] = {}
        self._changed = threading.Condition()
        self._states: dict[str, Change] = {}
        self._history: dict[str, list[Change]] = defaultdict(list)
        self._triggered: list[dict[str, Any]] = []
        self._automated: list[str] = []
        self._reader = threading.Thread(target=self._read, name="home-assistant", daemon=True)
        self._reader.start()
        for kind in ("state_changed", "automation_triggered"):
            self.ask("subscribe_events", event_type=kind)
        for state in self.ask("get_states"):
            self._learn_first(state)

    def close(self) -> None:
        """Ends the connection."""
        self._socket.close()
        self._reader.join(_ANSWER_S)

    # --- commands -------------------------------------------------------------------------------

    def ask(self, kind: str, **more: Any) -> Any:
        """Sends a command and returns its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "type": kind, **more}))
        with self._changed:
            assert self._changed.wait_for(lambda: number in self._answers, _ANSWER_S), kind
            answer = self._answers.pop(number)
        assert answer["success"], f"{kind} {more}: {answer['error']}"
        return answer["result"]

    def call(self, service: str, entity_id: str, **data: Any) -> None:
        """Calls a service such as `switch.turn_on`."""
        domain, name = service.split(".")
        target = {"entity_id": entity_id}
        self.ask("call_service", domain=domain, service=name, service_data=data, target=target)

    def entities(self) -> dict[str, dict[str, Any]]:
        """The MQTT entities of the registry, by unique id."""
        found = self.ask("config/entity_registry/list")
        ids = [entry["entity_id"] for entry in found if entry["platform"] == "mqtt"]
        entries = self.ask("config/entity_registry/get_entries", entity_ids=ids)
        # Null: it was removed between the two questions.
        return {entry["unique_id"]: entry for entry in entries.values() if entry is not None}

    def devices(self) -> dict[str, dict[str, Any]]:
        """The MQTT devices of the registry, by their identifier."""
        return {
            name: device
            for device in self.ask("config/device_registry/list")
            for domain, name in device["identifiers"]
            if domain == "mqtt"
        }

    def enable(self, entity_ids: Iterable[str]) -> None:
        """Switches on entities that are off by default. It takes effect after half a minute."""
        for entity_id in entity_ids:
            self.ask("config/entity_registry/update", entity_id=entity_id, disabled_by=None)

    def watch_trigger(self, trigger: dict[str, Any]) -> None:
        """From now on `wait_trigger` knows when this trigger of an automation fires."""
        self.ask("subscribe_trigger", trigger=trigger)

    @property
    def automated(self) -> list[str]:
        """The names of the automations that ran since this connection began, in their order."""
        with self._changed:
            return list(self._automated)

    # --- states ---------------------------------------------------------------------------------

    @property
    def states(self) -> dict[str, Change]:
        """All states as they are now."""
        with self._changed:
            return dict(self._states)

    def state(self, entity_id: str) -> str | None:
        """The state of one entity; None: there is none."""
        change = self.states.get(entity_id)
        return None if change is None else change.state

    def forget(self) -> None:
        """Begins the histories anew."""
        with self._changed:
            self._history.clear()

    def history(self, entity_id: str) -> list[Change]:
        """Return the states of one entity since this connection, or `forget`, oldest first."""
        with self._changed:
            return list(self._history[entity_id])

    @property
    def changes(self) -> int:
        """The number of changes of any state since this connection began."""
        with self._changed:
            return sum(len(changes) for changes in self._history.values())

    def wait_state(self, entity_id: str, state: str, timeout_s: float = WAIT_S) -> Change:
        """Wait until an entity has this state."""
        self.wait_for(
            lambda states: entity_id in states and states[entity_id].state == state,
            timeout_s,
            lambda: f"{entity_id} is {self.state(entity_id)}, not {state}",
        )
        return self.states[entity_id]

    def wait_for(
        self,
        condition: Callable[[dict[str, Change]], bool],
        timeout_s: float = WAIT_S,
        otherwise: Callable[[], str] = lambda: "the condition does not hold",
    ) -> None:
        """Wait until a condition holds for all states."""
        with self._changed:
            held = self._changed.wait_for(lambda: condition(self._states), timeout_s)
        assert held, f"{otherwise()} after {timeout_s} s"

    def wait_trigger(self, timeout_s: float = WAIT_S) -> dict[str, Any]:
        """Wait for the next trigger that fires; return its data."""
        with self._changed:
            assert self._changed.wait_for(lambda: bool(self._triggered), timeout_s), "no trigger"
            return self._triggered.pop(0)

    # --- the reader's thread --------------------------------------------------------------------

    def _read(self) -> None:
        try:
            for text in self._socket:
                message = json.loads(text)
                self._take(message)
        except ConnectionClosed:
            return

    def _take(self, message: dict[str, Any]) -> None:
        if message["type"] == "result":
            with self._changed:
                self._answers[message["id"]] = message
                self._changed.notify_all()
            return
        event = message.get("event", {})
        if "variables" in event:
            with self._changed:
                self._triggered.append(event["variables"]["trigger"])
                self._changed.notify_all()
        elif event.get("event_type") == "automation_triggered":
            with self._changed:
                self._automated.append(event["data"]["name"])
        elif event.get("event_type") == "state_changed":
            self._learn(event["data"]["entity_id"], event["data"]["new_state"])

    def _learn_first(self, state: dict[str, Any]) -> None:
        """Takes a state that was asked for: one that came by itself meanwhile is newer."""
        with self._changed:
            known = state["entity_id"] in self._history
        if not known:
            self._learn(state["entity_id"], state)

    def _learn(self, entity_id: str, state: dict[str, Any] | None) -> None:
        now = time.monotonic()
        with self._changed:
            if state is None:
                self._states.pop(entity_id, None)
                self._history[entity_id].append(Change(now, None, {}))
            else:
                change = Change(now, state["state"], state["attributes"])
                self._states[entity_id] = change
                self._history[entity_id].append(change)
            self._changed.notify_all()
