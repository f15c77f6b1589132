"""The soak itself: storms and calms by turns, and a look at the daemon in each calm."""

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.mosquitto import Mosquitto
from support.tcp_relay import TcpRelay

from soak import counted_daemon, log_lines, samples
from soak.commander import Commander
from soak.house import BASE, DEAD, LINES, LIVE, PULSE, Home, House, house, write_config
from soak.ledger import Ledger
from soak.report import BACK_WITHIN_S, Seen
from soak.troubles import Troubles

ROUND_S = 60.0
ROUNDS_AT_LEAST = 10  # of a short run
TICK_S = 0.05
TROUBLE_EVERY_S = 1.5
COMMAND_EVERY_S = 0.4
INPUT_EVERY_S = 0.3
CALM_SHARE = 0.2  # of a round, at the least
STOP_S = 20.0


def run(minutes: float, chance: random.Random, directory: Path) -> Seen:
    """Runs the daemon for so long, and tells what was seen of it."""
    broker = Mosquitto(directory / "mosquitto")
    broker.start()
    try:
        with house(chance) as built, TcpRelay(broker.port) as relay:
            write_config(directory / "config.yaml", built, relay.port)
            with _daemon(directory) as process:
                soak = _Soak(minutes, built, broker, relay, process, directory, chance)
                return soak.run()
    finally:
        broker.stop()


@contextmanager
def _daemon(directory: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The daemon in a process of its own, with a log."""
    wrapper = str(Path(counted_daemon.__file__).resolve())
    command = [sys.executable, wrapper, str(directory / "objects"), "run"]
    environ = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
    with (directory / "daemon.log").open("ab") as log:
        process = subprocess.Popen(
            [*command, "-c", str(directory / "config.yaml")], env=environ, stderr=log
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
            process.wait(STOP_S)


class _Soak:
    """One run. Used once, by the main thread."""

    def __init__(
        self,
        minutes: float,
        built: House,
        broker: Mosquitto,
        relay: TcpRelay,
        process: subprocess.Popen[bytes],
        directory: Path,
        chance: random.Random,
    ) -> None:
        self._seen = Seen(minutes)
        self._house = built
        self._process = process
        self._directory = directory
        self._chance = chance
        self._ledger = Ledger(frozenset({PULSE}))
        self._commander = Commander(broker.port, self._ledger, chance)
        self._troubles = Troubles(
            built, self._commander, self._ledger, broker, relay, process.send_signal, chance
        )
        self._began = time.monotonic()

    def run(self) -> Seen:
        """Storms and calms until the time is over, then the daemon is told to stop."""
        seconds = self._seen.minutes * 60
        round_s = min(ROUND_S, seconds / ROUNDS_AT_LEAST)
        try:
            self._calm(0.0)
            while self._elapsed() < seconds and self._process.poll() is None:
                self._storm(round_s * (1 - CALM_SHARE))
                self._calm(round_s * CALM_SHARE)
                self._look()
        finally:
            self._end()
        return self._seen

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    # --- storm --------------------------------------------------------------------------------

    def _storm(self, lasts_s: float) -> None:
        until = time.monotonic() + lasts_s
        trouble_at = command_at = input_at = 0.0
        while (now := time.monotonic()) < until and self._process.poll() is None:
            self._tick()
            if now >= trouble_at:
                self._troubles.begin()
                trouble_at = now + self._chance.expovariate(1 / TROUBLE_EVERY_S)
            if now >= command_at:
                self._commander.command()
                command_at = now + self._chance.expovariate(1 / COMMAND_EVERY_S)
            if now >= input_at:
                self._toggle_an_input()
                input_at = now + INPUT_EVERY_S
        self._troubles.undo_due(everything=True)

    def _tick(self) -> None:
        time.sleep(TICK_S)
        self._troubles.undo_due()
        self._commander.keep_connected()
        self._commander.listen()

    def _toggle_an_input(self) -> None:
        home = self._chance.choice([home for home in LIVE if home.model.inputs])
        self._house.module(home).toggle_input(self._chance.randint(1, home.model.inputs))

    # --- calm ---------------------------------------------------------------------------------

    def _calm(self, lasts_s: float) -> None:
        """Nothing is wrong any more: everything has to come back, and every verdict to come."""
        began = time.monotonic()
        while (waited_s := time.monotonic() - began) < BACK_WITHIN_S:
            self._tick()
            wrong = self._wrong()
            if wrong is None or self._process.poll() is not None:
                break
        else:
            self._seen.not_back.append(f"{self._elapsed():.0f} s: {self._wrong()}")
        self._seen.longest_back_s = max(self._seen.longest_back_s, waited_s)
        while time.monotonic() < began + lasts_s:
            self._tick()

    def _wrong(self) -> str | None:
        """What is not as it should be; None: everything is well."""
        states = self._commander.states
        availability = [f"{BASE}/bridge/state"]
        availability += [f"{BASE}/bridge/line/{line}/availability" for line in LINES]
        availability += [f"{BASE}/{home.id}/availability" for home in LIVE]
        for topic in availability:
            if states.get(topic) != b"online":
                return f"{topic} is {states.get(topic)!r}"
        for home in LIVE:
            if not self._is_true(home):
                return f"{home.id} is published as {states.get(f'{BASE}/{home.id}')!r}"
        if not self._ledger.link.whole:
            return "no ping came"
        return f"{self._ledger.waiting} verdicts are due" if self._ledger.waiting else None

    def _is_true(self, home: Home) -> bool:
        """Whether what is published of a module is what it says itself."""
        module = self._house.module(home)
        published = json.loads(self._commander.states.get(f"{BASE}/{home.id}", b"{}") or b"{}")
        truth = {
            "di": (home.model.inputs, module.inputs),
            "do": (home.model.outputs, module.outputs),
        }
        return all(
            published.get(bank)
            == {str(n + 1): "ON" if bits >> n & 1 else "OFF" for n in range(count)}
            for bank, (count, bits) in truth.items()
        )

    # --- looks --------------------------------------------------------------------------------

    def _look(self) -> None:
        self._judge()
        if self._process.poll() is not None:
            return
        sample = samples.take(self._process, self._directory / "objects", self._elapsed())
        self._seen.samples.append(sample)
        print(f"{sample}  commands {self._ledger.tally.sent}", flush=True)

    def _judge(self, *old_s: float) -> None:
        switchings = [self._house.switchings.popleft() for _ in range(len(self._house.switchings))]
        self._ledger.judge(switchings, time.monotonic(), *old_s)

    def _end(self) -> None:
        seen, process = self._seen, self._process
        if process.poll() is not None:
            seen.ended = f"exit status {process.returncode} after {self._elapsed():.0f} s"
        else:
            seen.cpu = samples.cpu_s(process) / self._elapsed()
            process.terminate()
        seen.exit_status = process.wait(STOP_S)
        self._commander.close()
        self._commander.listen()
        self._judge(0.0)
        log = self._directory / "daemon.log"
        seen.tally, seen.troubles = self._ledger.tally, self._troubles.begun
        seen.kinds = log_lines.kinds(log)
        seen.steady = log_lines.about(log, [home.id for home in DEAD])
