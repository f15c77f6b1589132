"""Reads a command of the panel: the same words, by the same reader, as over MQTT."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from bridge.config.current import CurrentConfig
from bridge.errors import CommandError
from bridge.model import BY_PANEL, AnyCommand, Reason, Status, Ticket, Verdict
from bridge.mqtt.commands import BadCommandError, parse_command
from bridge.mqtt.events import Received
from bridge.mqtt.payloads import as_json
from bridge.mqtt.strict_json import JsonObject, bad, read_object, read_text
from bridge.mqtt.topics import CommandTarget, CoverTarget, Topics

# Targets are read as topics are, below a base topic that nothing is published to.
_TOPICS = Topics("panel")
_KEYS = frozenset({"station", "target", "payload", "id", "deadline", "at", "run"})
_AHEAD_S = 1.0  # the clock of a page is set by ours, and runs on for itself


@dataclass(frozen=True, slots=True)
class Wish:
    """A command as it came, with a station that need not exist.

    Attributes:
        at: When it was pressed by the clock of the page; None: the sender does not tell.
    """

    station_id: str
    target: CommandTarget | CoverTarget
    payload: bytes
    at: float | None = None


def read_wish(body: bytes, run: str) -> Wish:
    """Read the body of `POST /api/command`.

    A page tells when it was pressed (`at`), by the clock of this `run` of the bridge: so a command
    that was held up on its way, or is of a page from before a restart, switches nothing.

    Raises:
        CommandError: It is none.
    """
    document = read_object(read_text(body))
    if document.repeated:
        raise bad(f"key {min(document.repeated)!a:.40} stands there twice")
    if unknown := document.keys() - _KEYS:
        raise bad(f"unknown key {min(unknown)!a:.40}")
    station_id, name = document.get("station"), document.get("target")
    if not isinstance(station_id, str) or not isinstance(name, str) or "payload" not in document:
        raise bad("station and target are texts, and payload says what is wanted")
    _check_payload(document["payload"])
    if "/" in station_id or station_id == "bridge":
        raise bad("station is the id of a module")
    topic = f"panel/{station_id}/set" if name == "do" else f"panel/{station_id}/{name}/set"
    target = _TOPICS.parse(topic)
    if not isinstance(target, CommandTarget | CoverTarget):
        raise bad("target is one of do/3, do, do/3/mode, do/3/hold, cover/ID, cover/ID/position")
    at = _pressed_at(document, run)
    return Wish(target.station_id, target, _as_payload(target, document), at)


def _pressed_at(document: Mapping[str, Any], run: str) -> float | None:
    at = document.get("at")
    if ("at" in document) is not ("run" in document):
        raise bad("at and run go together")
    if at is None:
        return None
    if isinstance(at, bool) or not isinstance(at, int | float):
        raise bad("at is a number of seconds")
    if document["run"] != run:
        raise CommandError(Reason.STALE_LINK, "the bridge was started anew since: look again")
    return float(at)


def _check_payload(payload: object) -> None:
    """Raise where a payload is nested deeper than any command is."""
    values = payload.values() if isinstance(payload, JsonObject) else [payload]
    if isinstance(payload, JsonObject) and payload.repeated:
        raise bad(f"output {min(payload.repeated)!a:.40} stands there twice")
    if not all(isinstance(value, str | int | float) for value in values):
        raise bad("payload is a word, a number, or an object of words")


def _as_payload(target: CommandTarget | CoverTarget, document: Mapping[str, Any]) -> bytes:
    rest = {key: document[key] for key in ("id", "deadline") if key in document}
    return as_json({target.key: document["payload"], **rest})


def command_of(
    wish: Wish, ticket: Ticket, at: float, current: CurrentConfig, now: float
) -> AnyCommand | Verdict | None:
    """Return the command, or the verdict on what is none; None: there is no such station.

    Args:
        wish: What was asked.
        ticket: By which the verdict is found.
        at: When it arrived.
        current: The configuration in force.
        now: The instant.
    """
    config = current.stations.get(wish.station_id)
    if config is None:
        return None
    # NaN fails the comparison.
    if wish.at is not None and not wish.at <= at + _AHEAD_S:
        error = CommandError(
            Reason.BAD_PAYLOAD, "at is in the future: the clock of the page is wrong"
        )
        return refusal(wish, ticket, at, now, error)
    since = at if wish.at is None else min(at, wish.at)
    received = Received("", wish.payload, retain=False, at=since)
    try:
        command = parse_command(wish.target, received, config, _TOPICS)
    except CommandError as error:
        return refusal(wish, ticket, at, now, error)
    return replace(command, reply_to=ticket)


def refusal(wish: Wish, ticket: Ticket, at: float, now: float, error: CommandError) -> Verdict:
    """Return the verdict on a command that does not reach its line."""
    return Verdict(
        station_id=wish.station_id,
        target=wish.target.name,
        payload=error.payload if isinstance(error, BadCommandError) else None,
        status=Status.REFUSED,
        ms=max(0, round((now - at) * 1000)),
        reason=Reason(error.reason),
        id=error.id if isinstance(error, BadCommandError) else None,
        detail=error.detail,
        reply_to=ticket,
        by=BY_PANEL,
    )
