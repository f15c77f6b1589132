"""Commands that come together, or soon behind each other: `python -m bench.scenes C:wisco ...`.

The broker is mosquitto as Debian configures it, and the sender has sockets as the system makes
them. Beside the bridge stands the limit of the wire, and a bare loop that makes the same writes.
"""

import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from support.mosquitto import Mosquitto

from bench.cases import Case, all_cases
from bench.daemon import MeasuredDaemon
from bench.figures import Spread
from bench.listener import Listener
from bench.priority import go_first
from bench.wire import Seen, Wire
from bridge.drivers import driver_for
from bridge.drivers.driver import Driver
from bridge.model import DO100, LineProtocol

_TIMES = 20
_COMMANDS = 80
_PAIRED = 400  # of these every second one counts
_APART_S = 0.4
_PATIENCE_S = 10.0
Wish = tuple[int, int]  # station and output


def main(chosen: Sequence[str]) -> int:
    """Prints one line for each figure."""
    go_first()
    names = chosen or [f"{letter}:{p}" for letter in "CSA" for p in ("modbus-rtu", "wisco")]
    cases = {f"{case.letter}:{case.protocol}": case for case in scene_cases()}
    with tempfile.TemporaryDirectory(prefix="bench-scenes-") as directory:
        broker = Mosquitto(Path(directory), options=("log_type none",))
        broker.start()
        try:
            for name in names:
                _run(cases[name], broker.port, Path(directory))
        finally:
            broker.stop()
    return 0


def scene_cases() -> list[Case]:
    """Those of the tables, and S: four DO100s at 9600 baud."""
    protocols = ("modbus-rtu", "wisco")
    many_outputs = [Case("S", protocol, 9600, 4, model=DO100) for protocol in protocols]
    return [*(case for case in all_cases() if case.paced and case.lines == 1), *many_outputs]


def _run(case: Case, broker: int, directory: Path) -> None:
    with Wire([case.spec]) as wire, Listener(broker, nodelay=False) as listener:
        _bare(case, wire)
        path = directory / f"{case.name}.yaml"
        path.write_text(case.config(wire.ports, broker, str(directory), plain=False))
        with MeasuredDaemon(path):
            listener.wait_online(case.live)
            time.sleep(2.0)
            bench = _Bench(case, wire, listener)
            for wishes in _scenes(case):
                bench.scene(wishes)
            if case.letter != "S":
                bench.stream(0.0, 0.05, pairs=True)
                bench.stream(0.06, 0.06)
                bench.stream(0.5, 0.5)
            print(f"{case.name}: the same to a listener that acknowledges at once:")
            with Listener(broker, nodelay=False, quickack=True) as prompt:
                bench.hear(prompt)
                for wishes in _scenes(case):
                    bench.scene(wishes)
                if case.letter != "S":
                    bench.stream(0.06, 0.06)
            print(f"{case.name}: the same, sent with QoS 0:")
            with Listener(broker, nodelay=False, quickack=True, qos=0) as windowless:
                bench.hear(windowless)
                for wishes in _scenes(case):
                    bench.scene(wishes)


def _scenes(case: Case) -> Iterator[list[Wish]]:
    if case.letter == "C":
        yield [(address, 1) for address in case.live[1:21]]
        yield [(address, output) for address in case.live[1:4] for output in range(1, 9)]
    if case.letter == "S":
        yield [(1, output) for output in range(1, 17)]
        yield [(address, output) for address in case.live for output in range(1, 17)]


def _bare(case: Case, wire: Wire) -> None:
    """Twenty writes behind each other, and nothing else."""
    addresses = [a for a in case.live if a != 0][:20]
    requests = [_write(case, address) for address in addresses]
    pairs = [f"{frame.hex()}:{size}" for frame, size in requests]
    arguments = [wire.ports[0], str(case.baud), str(case.physics.silence_s), "4"]
    wire.begin()
    subprocess.run([sys.executable, "-m", "bench.bare", *arguments, *pairs], check=True)
    at = [instant for instant, *_ in wire.take().writes]
    each = Spread.of(later - earlier for earlier, later in pairwise(at))
    assert each is not None
    print(f"{case.name}: one write {_write_s(case) * 1000:.2f} (limit) {each.p50:.2f} (bare loop)")


def _driver(case: Case, address: int) -> Driver:
    protocol = LineProtocol(case.protocol)
    framing = protocol.in_modbus
    return driver_for(framing, address, case.model)


def _write(case: Case, address: int, outputs: int = 1) -> tuple[bytes, int]:
    request = _driver(case, address).write_outputs(outputs, outputs, 0)
    return request.frame, request.reply_chars


def _write_s(case: Case, outputs: int = 1) -> float:
    frame, size = _write(case, 1, outputs)
    return case.physics.exchange_s(len(frame) + size)


def _read_s(case: Case) -> float:
    request = _driver(case, 1).read_outputs
    return case.physics.exchange_s(len(request.frame) + request.reply_chars)


class _Bench:
    """One bridge on one line."""

    def __init__(self, case: Case, wire: Wire, listener: Listener) -> None:
        self._case = case
        self._wire = wire
        self._listener = listener
        self._on: dict[Wish, bool] = {}
        self._number = 0

    def hear(self, listener: Listener) -> None:
        """From now on this one sends, and hears the verdicts."""
        self._listener = listener

    def scene(self, wishes: Sequence[Wish]) -> None:
        """All at once; until the last is on the wire, and until the last verdict."""
        to_wire, to_read, to_verdict = list[float](), list[float](), list[float]()
        writes, bad = list[int](), 0
        for _ in range(_TIMES):
            self._begin()
            sent_at = min(self._send(wish) for wish in wishes)
            at, statuses = self._verdicts(len(wishes))
            bad += sum(status != "done" for status in statuses)
            seen = self._wire.take()
            to_wire.append(seen.writes[-1][0] - sent_at)
            to_read.append(self._read_back_at(seen) - sent_at)
            to_verdict.append(at - sent_at)
            writes.append(len(seen.writes))
            time.sleep(0.3)
        stations = len({address for address, _ in wishes})
        limit_s = stations * _write_s(self._case, (1 << len(wishes) // stations) - 1)
        print(
            f"{self._case.name}: {len(wishes)} commands to {stations} stations: last on the wire "
            f"{_words(to_wire)}, last read back {_words(to_read)}, "
            f"last verdict {_words(to_verdict)}; {stations} writes take "
            f"{limit_s * 1000:.1f}, with their reads "
            f"{(limit_s + stations * _read_s(self._case)) * 1000:.1f}; "
            f"{sorted(writes)[_TIMES // 2]} writes in the middle, {max(writes)} at most; "
            f"{bad} not done",
            flush=True,
        )

    def _read_back_at(self, seen: Seen) -> float:
        """Return when the last of the stations was read: what comes after is MQTT's share."""
        reads = [(at, address) for at, _, address, kind in seen.reads if kind == "outputs"]
        read_at = [
            next((at for at, of in reads if of == address and at > written_at), written_at)
            for written_at, _, address, _ in seen.writes
        ]
        return max(read_at) + _read_s(self._case)

    def stream(self, least_s: float, most_s: float, *, pairs: bool = False) -> None:
        """One so long behind the other, until each is on the wire and judged.

        `pairs`: only two at a time, and of these the second counts.
        """
        chance, to_wire, to_verdict, bad = random.Random(12), list[float](), list[float](), 0  # noqa: S311
        stations = [a for a in self._case.live if a != 0]
        wishes = [(address, output) for output in range(1, 9) for address in stations]
        sent: list[tuple[float, Wish, str]] = []
        self._begin()
        for number in range(_PAIRED if pairs else _COMMANDS):
            wish = wishes[number * 3 % len(wishes)]
            sent_at = self._send(wish)
            sent.append((sent_at, wish, f"c{self._number}"))
            apart = pairs and number % 2 == 1
            time.sleep(_APART_S if apart else chance.uniform(least_s, most_s))
        _, statuses = self._verdicts(len(sent))
        bad = sum(status != "done" for status in statuses)
        seen, heard = self._wire.take().writes, self._listener.heard()
        told = {json.loads(p)["id"]: at for at, topic, p in heard if topic.endswith("/result")}
        for sent_at, (address, output), command_id in sent[1::2] if pairs else sent:
            wanted = self._before[command_id]
            at = next(
                (
                    at
                    for at, _, of, outputs in seen
                    if of == address
                    and at > sent_at
                    and bool(outputs >> (output - 1) & 1) is wanted
                ),
                None,
            )
            if at is not None:
                to_wire.append(at - sent_at)
            to_verdict.append(told[command_id] - sent_at)
        print(
            f"{self._case.name}: a command {least_s * 1000:.0f}-{most_s * 1000:.0f} ms behind the "
            f"one before: to the wire {_words(to_wire)}, to the verdict {_words(to_verdict)}; "
            f"one write takes {_write_s(self._case) * 1000:.1f}; {bad} not done",
            flush=True,
        )

    def _begin(self) -> None:
        self._before = dict[str, bool]()
        self._wire.begin()
        self._listener.begin()

    def _send(self, wish: Wish) -> float:
        address, output = wish
        self._number += 1
        on = self._on[wish] = not self._on.get(wish, False)
        self._before[f"c{self._number}"] = on
        word = json.dumps({"state": "ON" if on else "OFF", "id": f"c{self._number}"})
        return self._listener.publish(f"bench/l0-s{address}/do/{output}/set", word)

    def _verdicts(self, count: int) -> tuple[float, list[str]]:
        """Returns when the last came, and each status."""
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            found = [m for m in self._listener.heard() if m[1].endswith("/result")]
            if len(found) >= count:
                return found[-1][0], [json.loads(m[2])["status"] for m in found]
            assert time.monotonic() < deadline, f"{len(found)} of {count} verdicts"
            time.sleep(0.01)


def _words(seconds: Iterable[float]) -> str:
    spread = Spread.of(seconds)
    return f"{spread.p50:.1f} / {spread.p99:.1f}" if spread else "-"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
