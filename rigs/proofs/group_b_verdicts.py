"""A command without a verdict, and names that upset a broker: B8, B9."""

import json
import random
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from support.bus_worker import BusWorker
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.virtual_worker import make_line, make_station

from bridge.config.load import load_config
from bridge.config.schema import LineConfig
from bridge.errors import ConfigError
from bridge.model import DIO100, Command, LineProtocol, Verdict, Word, Writes
from bridge.mqtt.commands import PATIENCE_S
from bridge.simulator.faults import FaultKind
from bridge.transport.timing import LineTiming
from proofs.figures import Figure, Run, proof

# --- B8 ---------------------------------------------------------------------------------------

NAMES_A_STATION = 1 + DIO100.inputs + DIO100.outputs
STATIONS = 31
CLIENT = "names"
# Where each plane of Unicode keeps what programs stumble over; the rest is drawn from anywhere.
PITFALLS = (
    "\0\x01\x1f\x7f\x85\u2028\u2029\ufeff\ufffe\uffff\ufdd0\U0010ffff\u202e+#/$%{}[]\"'\\&*! "
)


def _name(chance: random.Random) -> str:
    length = chance.randint(1, 12)
    return "".join(
        chance.choice(PITFALLS) if chance.random() < 0.3 else chr(chance.randrange(0x110000))
        for _ in range(length)
    )


def _quoted(name: str) -> str:
    """Any text in YAML: every character as its number."""
    return '"' + "".join(f"\\U{ord(char):08x}" for char in name) + '"'


def _configuration(names: Iterator[str], port: int) -> str:
    """One name a line, so that a complaint tells which."""
    lines = [
        f"mqtt: {{host: 127.0.0.1, port: {port}, client_id: {CLIENT}}}",
        "lines:",
        "  - id: main",
        "    port: /dev/nowhere",
        "    protocol: modbus-rtu",
        "    baud: 9600",
        "    stations:",
    ]
    for address in range(1, STATIONS + 1):
        lines += [f"      - address: {address}", "        model: DIO100"]
        lines.append(f"        name: {_quoted(next(names))}")
        for kind, count in (("inputs", DIO100.inputs), ("outputs", DIO100.outputs)):
            lines.append(f"        {kind}:")
            lines += [
                f"          {n}: {{name: {_quoted(next(names))}}}" for n in range(1, count + 1)
            ]
    return "\n".join(lines) + "\n"


def _without_refused(path: Path) -> int:
    """Takes out the names that the configuration refuses, each with its line; counts them."""
    try:
        load_config(path, {"HOME": "/nowhere"})
    except ConfigError as error:
        lines = path.read_text().splitlines()
        wrong = {problem.line for problem in error.problems}
        for number in wrong:
            begin, _, _ = lines[number - 1].partition("name: ")
            lines[number - 1] = f"{begin}name: plain" + "}" * ("{" in begin)
        path.write_text("\n".join(lines) + "\n")
        return len(wrong)
    return 0


def _published_names(seen: list[Seen]) -> set[str]:
    """The `name`s of all discovery documents."""
    names: set[str] = set()

    def collect(document: Any) -> None:
        if isinstance(document, dict):
            if isinstance(document.get("name"), str):
                names.add(document["name"])
            for value in document.values():
                collect(value)

    for message in seen:
        if message.topic.endswith("/config"):
            collect(json.loads(message.payload))
    return names


def _configured_names(path: Path) -> set[str]:
    config = load_config(path, {"HOME": "/nowhere"})
    stations = config.lines[0].stations
    names = {station_config.name for station_config in stations}
    for station_config in stations:
        names |= {channel.name or station_config.name for channel in station_config.inputs}
        names |= {channel.name or station_config.name for channel in station_config.outputs}
    # A lone surrogate has no UTF-8 form.
    return {name.encode("utf-8", errors="replace").decode() for name in names}


@proof("B8")
def any_name_will_do(run: Run) -> Figure:
    """Names of any Unicode stand in JSON alone: the broker never hangs up on us."""
    files = run.scale.of(1, 10_000 // (STATIONS * NAMES_A_STATION) + 1)
    chance = random.Random(8)  # noqa: S311  # names, not secrets
    refused = missing = connects = 0
    for number in range(files):
        directory = run.directory / str(number)
        mosquitto = Mosquitto(directory / "mosquitto")
        mosquitto.start()
        path = directory / "config.yaml"
        path.write_text(_configuration(iter(lambda: _name(chance), ""), mosquitto.port))
        refused += _without_refused(path)
        wanted = _configured_names(path)
        with MqttProbe(mosquitto.port, "homeassistant/#", "wisco/#") as probe, Daemon(path):
            probe.wait_message("wisco/bridge/state", "online")
            missing += len(wanted - _published_names(probe.seen))
            connects += mosquitto.log.count(f" as {CLIENT} ")
        mosquitto.stop()
    names = files * STATIONS * NAMES_A_STATION
    return Figure(
        injected=f"{names} names of any Unicode, {refused} of them refused with their line",
        seen=f"{connects - files} disconnects, {missing} names missing from discovery",
        promised="0 disconnects",
        kept=connects == files and missing == 0 and refused < names,
    )


# --- B9 ---------------------------------------------------------------------------------------

WAYS = (
    (LineProtocol.MODBUS_RTU, Writes.AUTO),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO),
    (LineProtocol.WISCO, Writes.AUTO),
    (LineProtocol.WISCO, Writes.WISCO),
)
# A read before it, the write and its repetition; each read has three tries.
MOST_EXCHANGES = 3 + 2 * (1 + 3)
LONGEST_DRAIN_S = 0.2
LONGEST_FRAME_CHARS = 40


class _Sender:
    """Sends commands at random moments, whether those before are answered or not."""

    def __init__(self, worker: BusWorker, count: int, chance: random.Random) -> None:
        self._worker = worker
        self._left = count
        self._chance = chance

    def begin(self, kind: FaultKind) -> None:
        """Puts the fault on and begins."""
        self._worker.bus_line.faults.set(kind, probability=0.5)
        self.send()

    def send(self) -> None:
        """One command; then the next, or the end."""
        line, self._left = self._worker.line, self._left - 1
        self._worker.worker.submit(self._command())
        if self._left:
            line.at(line.now + self._chance.expovariate(2.0), self.send)
        else:
            line.at(line.now + 15.0, self._worker.worker.stop)

    def _command(self) -> Command:
        mask = self._chance.choice((1, 2, 4, 128, 0b1001, 0b11111111))
        word = self._chance.choice((None, None, Word.TOGGLE if mask.bit_count() == 1 else None))
        command = self._worker.command(mask, self._chance.getrandbits(8) & mask, word=word)
        return replace(command, id=self._left)


def _verdicts(config: LineConfig, kind: FaultKind, count: int) -> list[Verdict]:
    worker = BusWorker(config, seed=9)
    sender = _Sender(worker, count, random.Random(9))  # noqa: S311  # moments, not secrets
    worker.line.at(worker.line.now + 3.0, lambda: sender.begin(kind))
    worker.worker.work()
    return worker.verdicts()


def _longest_ms(config: LineConfig) -> float:
    timing = LineTiming.from_config(config)
    exchange_s = timing.timeout_s(LONGEST_FRAME_CHARS, LONGEST_FRAME_CHARS)
    each_s = exchange_s + config.late_window_s + LONGEST_DRAIN_S
    return 1000 * (PATIENCE_S + MOST_EXCHANGES * each_s)


@proof("B9")
def every_command_gets_one_verdict(run: Run) -> Figure:
    """With any fault on the line, each command gets one verdict in time."""
    count = run.scale.of(4, 500)
    wrong, late, longest_ms, statuses = 0, 0, 0, Counter[str]()
    for protocol, writes in WAYS:
        config = make_line(make_station(1), make_station(2), protocol=protocol, writes=writes)
        for kind in FaultKind:
            verdicts = _verdicts(config, kind, count)
            times = Counter(verdict.id for verdict in verdicts)
            wrong += sum(times[number] != 1 for number in range(count))
            late += sum(verdict.ms > _longest_ms(config) for verdict in verdicts)
            longest_ms = max([longest_ms, *(verdict.ms for verdict in verdicts)])
            statuses.update(verdict.status for verdict in verdicts)
    total = count * len(WAYS) * len(FaultKind)
    told = ", ".join(f"{n} {status}" for status, n in statuses.most_common())
    return Figure(
        injected=f"{len(FaultKind)} kinds of fault, {total} commands",
        seen=f"{wrong} without exactly one verdict, {late} late, longest {longest_ms} ms; {told}",
        promised="one verdict each, in 2 s and what its exchanges take",
        kept=wrong == 0 and late == 0,
    )
