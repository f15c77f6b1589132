"""`wisco2mqtt watch`: what the bridge publishes, live, through the broker."""

import argparse
import json
import os
import sys
from collections.abc import Callable
from datetime import UTC, datetime

from bridge.cli.desk.panel import objection_to_panel
from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.broker import TIMEOUT_S, Broker, add_timeout, at_broker
from bridge.cli.through_broker.where import add_broker, broker_of
from bridge.cli.views.monitor_view import wants_colour
from bridge.cli.views.watch_view import MessageWords, printable
from bridge.config.schema import Config
from bridge.mqtt.events import Received, Subscription
from bridge.mqtt.topics import Topics

NAME = "watch"
EXAMPLES = (
    "watch",
    "watch garage --all",
    "watch --json",
    "watch --host localhost",
)

# What stays on the screen of the panel: the demo says there what to try.
NOTE_VARIABLE = "WISCO2MQTT_NOTE"

Line = Callable[[Received, datetime], str | None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the stations and the form of the output."""
    parser.description = (
        "Prints a line for each change, in words: values, verdicts, modules that come and go, "
        "warnings. --all and --json print every topic as it is, also what the broker had kept, "
        "snapshots and diagnostics. --panel draws the modules with their LEDs."
    )
    parser.epilog = "With --all a line with = is what the broker had kept."
    parser.add_argument("stations", nargs="*", metavar="STATION", help="default: everything")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--all", action="store_true", help="print every topic and its payload")
    how.add_argument("--json", action="store_true", help="print a JSON object a topic")
    how.add_argument(
        "--panel", action="store_true", help="draw the modules, at a terminal (the extra `cli`)"
    )
    parser.add_argument(
        "--changes", action="store_true", help="with --all or --json: leave out what was kept"
    )
    add_timeout(parser)
    add_broker(parser)


def run(args: argparse.Namespace) -> int:
    """Print until SIGINT or SIGTERM, which is its normal end."""
    if args.panel and (objection := objection_to_panel()):
        raise UsageError(objection)
    mqtt, config = broker_of(args, args.stations)
    topics = Topics(mqtt.base_topic)
    one_by_one = [] if args.panel else args.stations  # a panel needs what the bridge says of all
    filters = [f"{topics.base}/{one}/#" for one in one_by_one] or [f"{topics.base}/#"]
    # Not as published: so `retain` marks the messages that the broker had stored.
    wanted = [Subscription(one, live_only=False, as_published=False) for one in filters]
    timeout_s, patient = args.timeout or TIMEOUT_S, args.timeout is not None
    with at_broker(mqtt, NAME, wanted, timeout_s, patient=patient) as broker:
        if args.panel:
            _show_panel(broker, topics, args.stations, os.environ.get(NOTE_VARIABLE, ""))
        else:
            live_only = args.changes or not (args.all or args.json)
            _print(broker, topics, _line_of(args, topics, config), live_only=live_only)
    return 0


def _print(broker: Broker, topics: Topics, line_of: Line, *, live_only: bool) -> None:
    if live_only and sys.stderr.isatty():
        told = f"watching {topics.base}: a line for each change; --all shows all that is known"
        print(told, file=sys.stderr)
    for message in broker.messages():
        if not _is_state(message.topic, topics) or (live_only and message.retain):
            continue
        line = line_of(message, datetime.now(UTC).astimezone())
        if line is not None:
            print(line, flush=True)


def _line_of(args: argparse.Namespace, topics: Topics, config: Config | None) -> Line:
    if args.json:
        return json_line
    if args.all:
        return lambda message, now: text_line(message, topics.base, now)
    return MessageWords(config, topics.base, colour=wants_colour(sys.stdout, os.environ)).line


def _show_panel(broker: Broker, topics: Topics, station_ids: list[str], note: str) -> None:
    from bridge.cli.desk.watch_panel import WatchPanel  # noqa: PLC0415  # needs an extra

    panel = WatchPanel(broker, topics, station_ids, note)
    panel.run()
    if panel.trouble is not None:
        raise panel.trouble


def text_line(message: Received, base: str, now: datetime) -> str:
    """Return a topic as it is: the time, `=` for what the broker had kept, topic and payload."""
    mark = "= " if message.retain else ""
    topic = printable(message.topic.removeprefix(f"{base}/"))
    payload = printable(message.payload.decode(errors="replace"))
    return f"{now:%H:%M:%S}.{now.microsecond // 1000:03} {mark}{topic} {payload}"


def json_line(message: Received, now: datetime) -> str:
    """Return one line for programs."""
    document = {
        "time": now.isoformat(timespec="milliseconds"),
        "topic": message.topic,
        "payload": message.payload.decode(errors="replace"),
        "retained": message.retain,
    }
    return json.dumps(document, ensure_ascii=False)


def _is_state(topic: str, topics: Topics) -> bool:
    return topic != topics.ping and not topic.endswith("/set")
