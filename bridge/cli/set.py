"""`wisco2mqtt set`: switches outputs or changes settings of one module on its port."""

import argparse
import json
import time
from dataclasses import replace
from typing import cast

from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.one_station import Visit, add_flags, find_place, visit
from bridge.cli.send import TypedCommand, understand
from bridge.cli.views.verdict_words import outcome
from bridge.clock import boot_s
from bridge.config.durations import parse_duration
from bridge.hub.admission import StationGate
from bridge.line.actions.settings_write import SettingsWrite
from bridge.line.actions.writes import Write
from bridge.model import (
    AnyCommand,
    Command,
    Reason,
    SettingCommand,
    Status,
    Verdict,
    Word,
    verdict_on,
)
from bridge.mqtt.commands import PATIENCE_S, parse_command
from bridge.mqtt.events import Received
from bridge.mqtt.payloads import verdict as verdict_json
from bridge.mqtt.topics import CommandTarget, Topics

NAME = "set"
EXAMPLES = (
    "set garage do/3 ON",
    "set garage do 1=ON,4=OFF",
    "set garage do/2/mode pulse",
    "set --port /dev/ttyUSB0 --station 1 do/2/hold 0.5",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the module, the target and the value."""
    parser.usage = "%(prog)s {STATION | --port PORT --station 0-31} TARGET VALUE [options]"
    parser.description = (
        "Switches outputs, or sets a mode or hold time, of one module: of a station of the "
        "configuration, or of --port and --station. It is done as the bridge does it: a pulse is "
        "sent once, everything is read back, and the verdict is printed. Modes and hold times lie "
        "in the module's EEPROM and are written only where they differ."
    )
    parser.add_argument(
        "words",
        nargs="+",
        metavar="[STATION] TARGET VALUE",
        help="STATION: its id, without --port. do/3 ON (OFF, TOGGLE, PRESS); do 1=ON,4=OFF; "
        "do/3/mode latch (pulse); do/3/hold 0.5 (seconds)",
    )
    add_flags(parser)
    parser.add_argument("--json", action="store_true", help="print the verdict as JSON")


def run(args: argparse.Namespace) -> int:
    """Return 0 when the module did it, and 1 otherwise."""
    place, words = find_place(args, args.words)
    asked = _understand(words)
    # It is not known whether it was done, and the message must not say either.
    unknown = f"{place.name} {asked.words} is not known: `wisco2mqtt get` reads what became of it"
    with saying(lambda: unknown), visit(place, f"send STATION {asked.words}") as met:
        verdict = _do(met, asked)
    document = verdict_json(verdict).decode()
    print(document if args.json else f"{place.name} {asked.words}: {outcome(json.loads(document))}")
    return 0 if verdict.status is Status.DONE else 1


def _understand(words: list[str]) -> TypedCommand:
    """Read TARGET and VALUE.

    Raises:
        UsageError: They are no command.
    """
    if len(words) != 2:  # noqa: PLR2004  # a target and a value
        raise UsageError("give a TARGET and a VALUE, such as do/3 ON")
    target, value = words
    if target.startswith("cover/"):
        raise UsageError("only the bridge moves covers: use `wisco2mqtt send`")
    return understand(target, _without_unit(value) if target.endswith("/hold") else value)


def _without_unit(text: str) -> str:
    """Return a hold time in seconds; what is none is left as it is."""
    try:
        seconds = parse_duration(text if text[-1:].isalpha() else f"{text}s")
    except ValueError:
        return text
    return f"{seconds.normalize():f}"


def _do(met: Visit, asked: TypedCommand) -> Verdict:
    command = _command(met, asked)
    if isinstance(command, SettingCommand):
        return SettingsWrite(command, met.station, met.bus, boot_s).run()
    return _switch(met, cast("Command", command))  # covers were refused


def _command(met: Visit, asked: TypedCommand) -> AnyCommand:
    """Make the command that the bridge would make of these words."""
    config, topics = met.station.config, Topics(NAME)
    known = {str(output.channel) for output in config.outputs}
    outputs = asked.request.get("do") or [asked.topic.split("/")[1]]
    if missing := [output for output in outputs if output not in known]:
        raise UsageError(f"{met.place.name} is a {config.model.name} and has no do/{missing[0]}")
    topic = f"{topics.base}/{config.id}/{asked.topic}"
    target = cast("CommandTarget", topics.parse(topic))  # `understand` made its topic
    received = Received(topic, json.dumps(asked.request).encode(), retain=False, at=boot_s())
    return parse_command(target, received, config, topics)


def _switch(met: Visit, command: Command) -> Verdict:
    """Do what the bridge does with such a command: check it, then write."""
    station = met.station
    if on := command.values if command.word is None else command.mask:
        # It is not known what was ON before our contact: the dead time begins there.
        time.sleep(max(0.0, station.interlock.wait_s(on, boot_s())))
    now = boot_s()
    command = replace(command, arrived=now, deadline=now + PATIENCE_S)
    gate = StationGate(station.config, now)
    gate.online = True
    gate.read_pulse(station.settings.pulse if station.settings else None)
    if command.word is Word.PRESS and not command.mask & gate.pressable:
        detail = "it is no pulse output: it would stay ON"
        return verdict_on(command, now, Status.REFUSED, Reason.BAD_PAYLOAD, detail=detail)
    if reason := gate.objection(command, now):
        return verdict_on(command, now, Status.REFUSED, reason)
    return Write([command], station, met.bus, boot_s, lambda _: False).run()
