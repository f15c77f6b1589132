"""Requests to the bridge: `B/bridge/request/V`, each answered on `B/bridge/response/V`."""

import logging
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.errors import CommandError
from bridge.mqtt.events import OutMessage, Received
from bridge.mqtt.link import STALE_WORDS, LinkCheck
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.payloads import as_json
from bridge.mqtt.strict_json import JsonObject, bad, read_id, read_object, read_text
from bridge.mqtt.topics import Topics

_log = logging.getLogger(__name__)

MOST_A_SECOND = 10
_VERB_CHARS = 48
_ID_KEYS = ("id", "transaction")  # users of zigbee2mqtt know the second one


Reply = Callable[[Mapping[str, Any]], None]


@dataclass(frozen=True, slots=True)
class BridgeRequest:
    """One request that is to be answered once.

    Attributes:
        arguments: What stood in its payload besides its id.
        id: The sender's own id: the answer repeats it.
        reply: Takes progress and answer in place of the broker's clients.
    """

    verb: str
    arguments: Mapping[str, Any]
    id: str | int | None = None
    reply: Reply | None = None


# Returns the data of the answer, or None if it comes later. Raises CommandError.
Handler = Callable[[BridgeRequest], Mapping[str, Any] | None]


class RequestDesk:
    """Takes requests and sends answers. Only the main thread uses it."""

    def __init__(
        self,
        topics: Topics,
        outbox: Outbox,
        link: LinkCheck,
        clock: Callable[[], float],
        *,
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._topics = topics
        self._outbox = outbox
        self._link = link
        self._clock = clock
        self._bounded = BoundedLog(_log, clock, budgets)
        self._handlers: dict[str, Handler] = {}
        self._fresh_only: set[str] = set()
        self._lately: deque[float] = deque(maxlen=MOST_A_SECOND)

    @property
    def verbs(self) -> list[str]:
        """Return the kinds of requests that are answered."""
        return sorted(self._handlers)

    def serve(self, verb: str, handler: Handler, *, fresh_only: bool = False) -> None:
        """Answer requests of one kind; `fresh_only` refuses those that may be old."""
        self._handlers[verb] = handler
        if fresh_only:
            self._fresh_only.add(verb)

    def receive(self, verb: str, received: Received) -> None:
        """Handle a message: exactly one answer, now or later."""
        if received.retain and not received.payload:
            return  # a client clears a retained request: this is not a request
        if not 1 <= len(verb) <= _VERB_CHARS:
            return  # no client waits for an answer there
        request = BridgeRequest(verb, {})
        try:
            document = _document(received.payload)
            request = BridgeRequest(verb, document, _mark(document))
            self._judge(request, document, received)
        except CommandError as error:
            self.refuse(request, error.detail)
        else:
            self._carry_out(request)

    def ask(self, verb: str, arguments: Mapping[str, Any], reply: Reply) -> None:
        """Handle a request of the panel: `reply` takes what else would be published."""
        self._carry_out(BridgeRequest(verb, arguments, reply=reply))

    def _carry_out(self, request: BridgeRequest) -> None:
        try:
            data = self._handler(request)(request)
        except CommandError as error:
            self.refuse(request, error.detail)
            return
        if data is not None:
            self.answer(request, data)

    def answer(self, request: BridgeRequest, data: Mapping[str, Any]) -> None:
        """Send the answer that it was done, with its data."""
        self._send(request, {"status": "ok", "data": data})

    def progress(self, request: BridgeRequest, data: Mapping[str, Any]) -> None:
        """Publish progress.

        It is dropped while the broker is away: the final answer has everything.
        """
        self._send(request, {"status": "ok", "data": data}, qos=0)

    def refuse(self, request: BridgeRequest, error: str) -> None:
        """Send the answer that it was not done."""
        known = request.verb if request.verb in self._handlers else ""
        text = f"request {request.verb}: {error}"
        self._bounded.tell(Cause.REQUEST, known, logging.INFO, text)
        self._send(request, {"status": "error", "data": {}, "error": error})

    def _handler(self, request: BridgeRequest) -> Handler:
        try:
            return self._handlers[request.verb]
        except KeyError:
            known = ", ".join(sorted(self._handlers))
            raise bad(f"unknown request; there are {known}") from None

    def _judge(self, request: BridgeRequest, document: JsonObject, received: Received) -> None:
        """Raise CommandError if a request of any kind must not be carried out."""
        if document.repeated:
            raise bad(f"key {min(document.repeated)!a:.40} stands there twice")
        if received.retain:
            raise bad("retained: requests are never published with the retain flag")
        if request.verb in self._fresh_only and self._link.stale(received.at):
            raise bad(f"stale_link: {STALE_WORDS}")
        now = self._clock()
        if len(self._lately) == MOST_A_SECOND and now - self._lately[0] < 1.0:
            raise bad(f"too many requests: at most {MOST_A_SECOND} in a second")
        self._lately.append(now)

    def _send(self, request: BridgeRequest, answer: Mapping[str, Any], qos: int = 1) -> None:
        if request.reply is not None:
            request.reply(answer)
            return
        repeated = {} if request.id is None else {"id": request.id}
        payload = as_json({**answer, **repeated})
        topic = self._topics.response(request.verb)
        self._outbox.put(OutMessage(topic, payload, qos=qos, retain=False), self._clock())


def only(request: BridgeRequest, *keys: str) -> None:
    """Raise CommandError if a request has a key that would be ignored."""
    for key in request.arguments:
        if key not in keys:
            raise bad(f"unknown key {key!a:.40}")


def _document(payload: bytes) -> JsonObject:
    text = read_text(payload)
    return read_object(text) if text else JsonObject()


def _mark(document: JsonObject) -> str | int | None:
    """Take the id out of the document."""
    ids = [found for key in _ID_KEYS if (found := read_id(document, key)) is not None]
    for key in _ID_KEYS:
        document.pop(key, None)
    return ids[0] if ids else None
