"""Lines in trouble: `python -m bench.troubles K:wisco R:modbus-rtu ...`, with the broker of scenes.

K: of 32 modules 31 die; from 20 s after that inputs of the living one change, and it is commanded.
R: four DO100s of which 5 % of the replies are lost: all ON, and 0 to 1 s later all OFF.
"""

import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from support.mosquitto import Mosquitto

from bench.cases import Case
from bench.daemon import MeasuredDaemon
from bench.figures import Spread, delays_of_inputs
from bench.listener import Listener
from bench.priority import go_first
from bench.scenes import scene_cases
from bench.wire import Wire

_PATIENCE_S = 130.0
_AFTER_LOSS_S = 20.0
_WATCHED_S = 120.0
_ON_OFF = 200
_STEPS = 21  # of 50 ms, from 0 s to 1 s
_DEADLINE_S = 10.0


def main(chosen: Sequence[str]) -> int:
    """Prints one line for each."""
    go_first()
    names = chosen or ("K:wisco", "K:modbus-rtu", "R:wisco", "R:modbus-rtu")
    with tempfile.TemporaryDirectory(prefix="bench-troubles-") as directory:
        broker = Mosquitto(Path(directory), options=("log_type none", "max_queued_messages 0"))
        broker.start()
        try:
            for name in names:
                _run(name, broker.port, Path(directory))
        finally:
            broker.stop()
    return 0


def _run(name: str, broker: int, directory: Path) -> None:
    letter, protocol = name.split(":")
    cases = {(case.letter, case.protocol): case for case in scene_cases()}
    case = cases["C" if letter == "K" else "S", protocol]
    if letter == "R":
        case = replace(case, lost=0.05)
    with Wire([case.spec]) as wire, Listener(broker, nodelay=False) as listener:
        path = directory / f"{letter}-{protocol}.yaml"
        path.write_text(case.config(wire.ports, broker, str(directory), plain=False))
        with MeasuredDaemon(path):
            listener.wait_online(case.live)
            time.sleep(3.0)
            if letter == "K":
                _dead(case, wire, listener)
            else:
                _on_off(case, wire, listener)


def _dead(case: Case, wire: Wire, listener: Listener) -> None:
    living = case.live[7]
    died_at = wire.kill(0, frozenset(case.live) - {living})
    time.sleep(_AFTER_LOSS_S)
    wire.begin()
    listener.begin()
    wire.toggle(0.25)
    chance, sent = random.Random(31), dict[str, float]()  # noqa: S311
    while time.monotonic() < died_at + _AFTER_LOSS_S + _WATCHED_S:
        command_id = f"k{len(sent)}"
        word = json.dumps({"state": "OFF" if len(sent) % 2 else "ON", "id": command_id})
        topic = f"bench/l0-s{living}/do/{len(sent) // 2 % 8 + 1}/set"
        sent[command_id] = listener.publish(topic, word)
        time.sleep(chance.uniform(0.5, 1.0))
    wire.toggle(0)
    time.sleep(2.0)
    seen, heard = wire.take(), listener.heard()
    verdicts = [(at, json.loads(p)) for at, topic, p in heard if topic.endswith("/result")]
    inputs = delays_of_inputs(seen, heard)
    done = Spread.of(at - sent[verdict["id"]] for at, verdict in verdicts)
    vain = sum(address != living for *_, address, _ in seen.reads)
    back = _found_again(case, wire, listener, living)
    print(
        f"K {case.protocol}: input to MQTT {_words(inputs)}, command to verdict {_words(done)}, "
        f"{sum(verdict['status'] != 'done' for _, verdict in verdicts)} of {len(sent)} not done, "
        f"{vain / (seen.reads[-1][0] - seen.reads[0][0]):.2f} probes a second; found again {back}",
        flush=True,
    )


def _found_again(case: Case, wire: Wire, listener: Listener, living: int) -> str:
    """Three modules come back one after the other; until each is online."""
    found = []
    gone = frozenset(case.live) - {living}
    for address in sorted(gone)[3::10]:
        listener.begin()
        gone -= {address}
        at = wire.kill(0, gone)
        topic = f"bench/l0-s{address}/availability"
        listener.wait_online([address], _PATIENCE_S)
        online = [t for t, name, p in listener.heard() if (name, p) == (topic, b"online")]
        found.append(f"{online[0] - at:.1f}")
    return f"after {', '.join(found)} s"


def _on_off(case: Case, wire: Wire, listener: Listener) -> None:
    outputs = range(1, case.model.outputs + 1)
    wishes = [(address, output) for address in case.live for output in outputs]
    left, judged, twice, statuses = 0, 0, 0, Counter[str]()
    for number in range(_ON_OFF):
        listener.begin()
        marks = []
        for word, pause_s in (("ON", number % _STEPS * 0.05), ("OFF", 0.0)):
            for address, output in wishes:
                marks.append(f"r{number}-{word}-{address}-{output}")
                text = json.dumps({"state": word, "id": marks[-1]})
                listener.publish(f"bench/l0-s{address}/do/{output}/set", text)
            time.sleep(pause_s)
        told = _told(listener, len(marks))
        judged += sum(told[command_id] == 1 for command_id in marks)
        twice += sum(count > 1 for count in told.values())
        for _, topic, payload in listener.heard():
            if topic.endswith("/result"):
                verdict = json.loads(payload)
                word = verdict["id"].split("-")[1]
                statuses[f"{word} {verdict['status']} {verdict.get('reason', '')}".strip()] += 1
        left += sum(value.bit_count() for value in wire.outputs(0).values())
    print(
        f"R {case.protocol}: {_ON_OFF} times {len(wishes)} outputs ON, 0-1 s later OFF, 5 % of "
        f"replies lost: {left} relays left ON, {judged} of {2 * len(wishes) * _ON_OFF} commands "
        f"with one verdict, {twice} with more; {dict(statuses.most_common())}",
        flush=True,
    )


def _told(listener: Listener, count: int) -> Counter[str]:
    """Wait for so many verdicts, and a little for more; return how many each command has."""
    deadline = time.monotonic() + _DEADLINE_S
    while True:
        results = [p for _, topic, p in listener.heard() if topic.endswith("/result")]
        if len(results) >= count or time.monotonic() > deadline:
            return Counter(json.loads(payload)["id"] for payload in results)
        time.sleep(0.02)


def _words(spread: Spread | None) -> str:
    return f"{spread.p50:.1f} / {spread.p99:.1f} / {spread.most:.1f}" if spread else "-"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
