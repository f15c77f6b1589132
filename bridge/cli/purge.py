"""`wisco2mqtt purge`: clears what a bridge has left on its broker, after a question."""

import argparse
import os
import sys
import time
from collections.abc import Collection, Mapping

from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.interrupt import saying
from bridge.cli.through_broker.broker import TIMEOUT_S, Broker, at_broker
from bridge.config.load import find_config, load_config
from bridge.errors import BridgeError
from bridge.mqtt.announce.leftovers import only_retained
from bridge.mqtt.announce.migration import DiscoveryTopics
from bridge.mqtt.events import OutMessage, Received
from bridge.mqtt.payloads import CLEARED, ONLINE
from bridge.mqtt.topics import Topics

NAME = "purge"
EXAMPLES = ("purge --yes",)

_QUIET_S = 0.7  # what is retained comes at once, one message after the other
_LOOK_S = 10.0
_CLEAR_S = 30.0
_STATE = "/bridge/state"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare whether it asks."""
    parser.description = (
        "Takes states, availability and announcements off the broker: all that is retained below "
        "the base topic of the configuration, and what Home Assistant was told, which then forgets "
        "these devices. For a removal, or before another base topic. Bridges whose base topic "
        "lies below this one keep theirs. The bridge has to be stopped before."
    )
    parser.add_argument("--yes", action="store_true", help="clear without asking")
    parser.add_argument(
        "--force", action="store_true", help="clear also while the broker says that the bridge runs"
    )


def run(args: argparse.Namespace) -> int:
    """Give 0 when nothing is left, or was there; no is 0 too."""
    config = load_config(find_config(args.config), os.environ)
    topics, discovery = Topics(config.mqtt.base_topic), DiscoveryTopics(config)
    wanted = [only_retained(f"{topics.base}/#"), *discovery.subscriptions()]
    where = f"{config.mqtt.host}:{config.mqtt.port}"
    with at_broker(config.mqtt, NAME, wanted, TIMEOUT_S) as broker:
        retained = _retained(broker)
        states = _ours(retained, topics)
        announced = [topic for topic in retained if discovery.parse(topic) is not None]
        if not states and not announced:
            print(f"nothing is retained of {topics.base} at {where}", file=sys.stderr)
            return 0
        if retained.get(topics.bridge_state) == ONLINE and not args.force:
            raise BridgeError(
                f"the bridge runs: {topics.bridge_state} says online; stop it first, with "
                "sudo systemctl stop wisco2mqtt (--force clears it even so)"
            )
        what = f"{len(states)} topics below {topics.base} and {len(announced)} announcements"
        question = f"clear {what} at {where}?"
        if confirmed(question, yes=args.yes, otherwise="nothing is cleared"):
            # States last: an entity that still exists would fail on an empty state.
            _clear(broker, [*announced, *states])
            print(f"{what} at {where} are cleared", file=sys.stderr)
    return 0


def _retained(broker: Broker) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    until = time.monotonic() + _LOOK_S
    while (message := _next(broker, min(until, time.monotonic() + _QUIET_S))) is not None:
        if message.retain:
            found[message.topic] = message.payload
    return found


def _next(broker: Broker, until: float) -> Received | None:
    return next(broker.messages(until), None)


def _ours(retained: Mapping[str, bytes], topics: Topics) -> list[str]:
    """Pick out what lies below the base topic, and not below that of another bridge."""
    own = f"{topics.base}/"
    others = [
        topic.removesuffix(_STATE)
        for topic in retained
        if topic.startswith(own) and topic.endswith(_STATE) and topic != topics.bridge_state
    ]
    return [
        topic
        for topic in retained
        if topic.startswith(own)
        and not any(topic == other or topic.startswith(f"{other}/") for other in others)
    ]


def _clear(broker: Broker, found: Collection[str]) -> None:
    """Clear each topic, and wait until the broker has told of each."""
    left = set(found)
    with saying(lambda: f"{len(found) - len(left)} of {len(found)} topics are cleared"):
        for topic in found:
            broker.publish(OutMessage(topic, CLEARED, qos=1, retain=True))
        for message in broker.messages(time.monotonic() + _CLEAR_S):
            if message.payload == CLEARED:
                left.discard(message.topic)
            if not left:
                return
    raise BridgeError(
        f"the broker does not say that {len(left)} of {len(found)} topics are cleared, such as "
        f"{min(left)}: may this user write there?"
    )
