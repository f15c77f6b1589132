"""`wisco2mqtt set`: switches or sets one module on its port, without a broker."""

import argparse
import json
import time
from collections.abc import Iterable

from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.one_station import Visit, add_flags, find_place, visit
from bridge.cli.send import outcome
from bridge.cli.set_words import Setting, Switching, understand_words
from bridge.clock import boot_s
from bridge.hub.admission import StationGate
from bridge.line.actions.settings_write import SettingsWrite
from bridge.line.actions.writes import Write
from bridge.model import Command, Reason, SettingCommand, Status, Verdict, Word, bit, verdict_on
from bridge.mqtt.commands import PATIENCE_S
from bridge.mqtt.payloads import verdict as verdict_json

NAME = "set"
HELP = "switch or set one module on its port, without a broker"
EXAMPLES = (
    "set garage do/3 ON",
    "set garage do 1=ON,4=OFF",
    "set garage do/2/mode pulse",
    "set --port /dev/ttyUSB0 --station 1 do/2/hold 0.5",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare who is set, and to what."""
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
    """Give 0 when the module did it, and 1 otherwise."""
    place, words = find_place(args, args.words)
    asked = understand_words(words)
    # It may be done or not: it may not be taken for either.
    unknown = f"{place.name} {asked.words} is not known: `wisco2mqtt get` reads what became of it"
    with saying(lambda: unknown), visit(place, f"send STATION {asked.words}") as met:
        verdict = _switch(met, asked) if isinstance(asked, Switching) else _set(met, asked)
    document = verdict_json(verdict).decode()
    print(document if args.json else f"{place.name} {asked.words}: {outcome(json.loads(document))}")
    return 0 if verdict.status is Status.DONE else 1


def _switch(met: Visit, asked: Switching) -> Verdict:
    """Do what the bridge does with such a command: its objections, then its write."""
    _check_outputs(met, asked.states)
    station, words = met.station, asked.states.values()
    if on := sum(bit(output) for output, word in asked.states.items() if word is not Word.OFF):
        # What was ON before we met it it is not known: the dead time runs from there.
        time.sleep(max(0.0, station.interlock.wait_s(on, boot_s())))
    now = boot_s()
    command = Command(
        station=station.config.id,
        target=asked.target,
        payload=asked.payload,
        mask=sum(bit(output) for output in asked.states),
        values=sum(bit(o) for o, word in asked.states.items() if word in {Word.ON, Word.PRESS}),
        word=next((word for word in words if word not in {Word.ON, Word.OFF}), None),
        arrived=now,
        deadline=now + PATIENCE_S,
    )
    gate = StationGate(station.config, now)
    gate.online = True
    gate.read_pulse(station.settings.pulse if station.settings else None)
    if command.word is Word.PRESS and not command.mask & gate.pressable:
        detail = "it is no pulse output: it would stay ON"
        return verdict_on(command, now, Status.REFUSED, Reason.BAD_PAYLOAD, detail=detail)
    if reason := gate.objection(command, now):
        return verdict_on(command, now, Status.REFUSED, reason)
    return Write([command], station, met.bus, boot_s, lambda _: False).run()


def _set(met: Visit, asked: Setting) -> Verdict:
    _check_outputs(met, [asked.output])
    now = boot_s()
    command = SettingCommand(
        station=met.station.config.id,
        target=asked.target,
        payload=asked.payload,
        output=asked.output,
        setting=asked.setting,
        value=asked.value,
        arrived=now,
        deadline=now + PATIENCE_S,
    )
    return SettingsWrite(command, met.station, met.bus, boot_s).run()


def _check_outputs(met: Visit, outputs: Iterable[int]) -> None:
    known = {output.channel for output in met.station.config.outputs}
    if missing := [output for output in outputs if output not in known]:
        model = met.station.config.model.name
        raise UsageError(f"{met.place.name} is a {model} and has no do/{missing[0]}")
