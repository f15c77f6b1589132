"""`wisco2mqtt watch`: prints the state topics live, one line for each message."""

import argparse
import json
import os
from datetime import UTC, datetime

from bridge.cli.frame.usage import check_stations
from bridge.cli.through_broker.broker import add_timeout, at_broker
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config
from bridge.mqtt.events import Received, Subscription
from bridge.mqtt.topics import Topics

NAME = "watch"
HELP = "print the state topics live, through the broker"
EXAMPLES = (
    "watch",
    "watch garage --changes",
    "watch --json",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the stations and the form of the output."""
    parser.epilog = "A line with = is what the broker had kept; those without it happen now."
    parser.add_argument("stations", nargs="*", metavar="STATION", help="default: everything")
    parser.add_argument("--changes", action="store_true", help="leave out what the broker had kept")
    parser.add_argument("--json", action="store_true", help="print a JSON object a line")
    add_timeout(parser)


def run(args: argparse.Namespace) -> int:
    """Print until SIGINT or SIGTERM, which is its normal end."""
    config = load_config(find_config(args.config), os.environ)
    topics = Topics(config.mqtt.base_topic)
    line_of = json_line if args.json else text_line
    with at_broker(config.mqtt, NAME, _subscriptions(args.stations, config), args.timeout) as at:
        for message in at.messages():
            if _is_state(message.topic, topics) and not (args.changes and message.retain):
                print(line_of(message, topics.base, datetime.now(UTC).astimezone()), flush=True)
    return 0


def text_line(message: Received, base: str, now: datetime) -> str:
    """Return one line for people: time, `=` for a retained message, topic and payload."""
    mark = "= " if message.retain else ""
    topic = _printable(message.topic.removeprefix(f"{base}/"))
    return f"{now:%H:%M:%S}.{now.microsecond // 1000:03} {mark}{topic} {_text(message.payload)}"


def json_line(message: Received, _base: str, now: datetime) -> str:
    """Return one line for programs."""
    document = {
        "time": now.isoformat(timespec="milliseconds"),
        "topic": message.topic,
        "payload": message.payload.decode(errors="replace"),
        "retained": message.retain,
    }
    return json.dumps(document, ensure_ascii=False)


def _subscriptions(stations: list[str], config: Config) -> list[Subscription]:
    check_stations(stations, config)
    base = config.mqtt.base_topic
    filters = [f"{base}/{station}/#" for station in stations] or [f"{base}/#"]
    # Not as published: so `retain` marks the messages that the broker had stored.
    return [Subscription(one, live_only=False, as_published=False) for one in filters]


def _is_state(topic: str, topics: Topics) -> bool:
    return topic != topics.ping and not topic.endswith("/set")


def _text(payload: bytes) -> str:
    return _printable(payload.decode(errors="replace"))


def _printable(text: str) -> str:
    # Any client may write to a broker: no payload may break a line or control a terminal.
    return "".join(one if one.isprintable() else f"\\x{ord(one):02x}" for one in text)
