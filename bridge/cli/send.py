"""`wisco2mqtt send`: sends one command through the broker and prints its verdict."""

import argparse
import json
import re
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.broker import TIMEOUT_S, Broker, add_timeout, at_broker
from bridge.cli.through_broker.where import add_broker, broker_of
from bridge.cli.views.verdict_words import outcome
from bridge.config.durations import plain_seconds, tenths
from bridge.config.schema import MqttConfig
from bridge.errors import BridgeError
from bridge.model import HOLD_DS, Status, Word
from bridge.mqtt.commands import LONGEST_DEADLINE_S, PATIENCE_S, SHORTEST_DEADLINE_S
from bridge.mqtt.events import OutMessage, Subscription
from bridge.mqtt.strict_json import object_of
from bridge.mqtt.topics import Topics

NAME = "send"
EXAMPLES = (
    "send garage do/3 ON",
    "send garage do 1=ON,4=OFF --json",
    "send garage do/3/mode pulse",
    "send garage do/3/hold 0.5",
    "send garage cover/shutter OPEN",
    "send garage cover/shutter 40",
    "send --host localhost garage do/3 OFF",
)

_SPARE_S = 5.0  # the verdict comes within the deadline and the time of its exchanges
_ONE = re.compile(r"do/[1-9][0-9]?")
_SETTING = re.compile(r"do/[1-9][0-9]?/(mode|hold)")
_COVER = re.compile(r"cover/[a-z0-9_-]{1,48}")
_ASSIGNMENT = re.compile(r"([1-9][0-9]?)=(ON|OFF)")


@dataclass(frozen=True, slots=True)
class TypedCommand:
    """A command that was read from the words of the user.

    Attributes:
        words: The words, for the printed line.
        topic: Below the station: `do/3/set`, or `set`.
        request: The payload without id and deadline.
    """

    words: str
    topic: str
    request: Mapping[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command, the station and the deadline."""
    parser.epilog = (
        "Several outputs go in one write. Modes and hold times lie in the module's EEPROM and are "
        "written only where they differ. Exit status: 0 when the module did it, else 1."
    )
    parser.add_argument("station", metavar="STATION", help="its id in the configuration")
    parser.add_argument(
        "target",
        metavar="TARGET",
        help="do/3, do for several outputs, do/3/mode, do/3/hold or cover/ID",
    )
    parser.add_argument(
        "value",
        metavar="VALUE",
        help="ON, OFF, TOGGLE, PRESS; 1=ON,4=OFF; latch, pulse; seconds; OPEN, CLOSE, STOP, 40",
    )
    parser.add_argument("--id", help="the mark that the verdict repeats (default: drawn)")
    parser.add_argument(
        "--deadline",
        type=float,
        metavar="SECONDS",
        help=f"nothing is switched later than this (default: {PATIENCE_S:g})",
    )
    parser.add_argument("--json", action="store_true", help="print the verdict as it came")
    add_timeout(parser)
    add_broker(parser)


def run(args: argparse.Namespace) -> int:
    """Return 0 when the module did it, and 1 otherwise."""
    asked = understand(args.target, args.value)
    _check_deadline(args.deadline)
    mqtt, _ = broker_of(args, [args.station])
    raw = _exchange(args, asked, mqtt)
    verdict = json.loads(raw)
    print(raw if args.json else f"{args.station} {asked.words}: {outcome(verdict)}")
    return 0 if verdict.get("status") == Status.DONE else 1


def understand(target: str, value: str) -> TypedCommand:
    """Return the command in the words of the user.

    Raises:
        UsageError: It is not a command.
    """
    if found := _SETTING.fullmatch(target):
        words = f"{target} {value}"
        return TypedCommand(words, f"{target}/set", {found[1]: _setting(target, value)})
    value = value.upper()
    if _ONE.fullmatch(target):
        if value not in set(Word):
            raise UsageError(f"{value} is no command to {target}: give one of {', '.join(Word)}")
        return TypedCommand(f"{target} {value}", f"{target}/set", {"state": value})
    if target == "do":
        return TypedCommand(f"{target} {value}", "set", {"do": _several(value)})
    if _COVER.fullmatch(target):
        return _to_cover(target, value)
    raise UsageError(
        f"{target} is no target: give do/3, do for several outputs, do/3/mode, do/3/hold, cover/ID"
    )


def _to_cover(target: str, value: str) -> TypedCommand:
    words = f"{target} {value}"
    if value in {"OPEN", "CLOSE", "STOP"}:
        return TypedCommand(words, f"{target}/set", {"state": value})
    if not re.fullmatch(r"[0-9]{1,3}", value):
        raise UsageError(
            f"{value} is no command to {target}: give OPEN, CLOSE, STOP or a percentage"
        )
    return TypedCommand(words, f"{target}/position/set", {"position": int(value)})


def _setting(target: str, value: str) -> str | float:
    if target.endswith("mode"):
        if value not in {"latch", "pulse"}:
            raise UsageError(f"{value} is no mode: give latch or pulse")
        return value
    seconds = plain_seconds(value)
    if seconds is None or tenths(seconds) not in HOLD_DS:
        raise UsageError(f"{value} is no hold time: give 0.1 to 25.5 seconds, in steps of 0.1 s")
    return seconds


def _several(value: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for part in value.split(","):
        found = _ASSIGNMENT.fullmatch(part)
        if found is None or found[1] in values:
            raise UsageError(f"{value} is no command to do: give each output once, as 1=ON,4=OFF")
        values[found[1]] = found[2]
    return values


def _check_deadline(deadline_s: float | None) -> None:
    if deadline_s is not None and not SHORTEST_DEADLINE_S <= deadline_s <= LONGEST_DEADLINE_S:
        least, most = SHORTEST_DEADLINE_S, LONGEST_DEADLINE_S
        raise UsageError(f"a deadline is {least:g} to {most:g} s, not {deadline_s:g}")


def _exchange(args: argparse.Namespace, asked: TypedCommand, config: MqttConfig) -> str:
    """Send the command; return its verdict as JSON."""
    topics = Topics(config.base_topic)
    command_id = args.id or secrets.token_hex(8)
    request = {**asked.request, "id": command_id}
    if args.deadline is not None:
        request["deadline"] = args.deadline
    payload = json.dumps(request).encode()
    message = OutMessage(
        f"{topics.base}/{args.station}/{asked.topic}", payload, qos=1, retain=False
    )
    wanted = (
        Subscription(topics.result(args.station)),
        Subscription(topics.bridge_state, live_only=False),
    )
    patient = args.timeout is not None
    with at_broker(config, NAME, wanted, args.timeout or TIMEOUT_S, patient=patient) as broker:
        sent = f"{args.station} {asked.words} was sent, and what became of it is not known"
        with saying(lambda: sent):
            broker.publish(message)
            return _verdict(broker, command_id, topics, (args.deadline or PATIENCE_S) + _SPARE_S)


def _verdict(broker: Broker, command_id: str, topics: Topics, wait_s: float) -> str:
    bridge_state = "was never published"
    for message in broker.messages(until=time.monotonic() + wait_s):
        text = message.payload.decode(errors="replace")
        if message.topic == topics.bridge_state:
            bridge_state = f"says {text}"
        elif object_of(text).get("id") == command_id:
            return text
    raise BridgeError(
        f"no verdict in {wait_s:g} s: is the bridge running? {topics.bridge_state} {bridge_state}"
    )
