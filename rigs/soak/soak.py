"""The soak: storms and calms by turns, a look at the daemon in each calm, stops at the end."""

import random
import signal
import time
from pathlib import Path
from subprocess import Popen

from proofs.shifted_daemon import write_shifts
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.tcp_relay import TcpRelay

from soak import counted_daemon, log_lines, samples
from soak.commander import Commander
from soak.configuration import Configuration
from soak.house import DEAD, LINES, LIVE, RULES, House, house
from soak.ledger import Ledger
from soak.report import BACK_WITHIN_S, Seen
from soak.troubles import Troubles
from soak.truth import what_is_untrue
from soak.upkeep import Upkeep

ROUND_S = 60.0
ROUNDS_AT_LEAST = 10  # of a short run
TICK_S = 0.05
TROUBLE_EVERY_S = 1.5
COMMAND_EVERY_S = 0.4
INPUT_EVERY_S = 0.3
CALM_SHARE = 0.2  # of a round, at the least
STOP_S = 20.0
# Memory is judged of one process, so it is stopped and started after that.
STOPS_AN_HOUR, STOPS_AT_LEAST = 30, 3
MOVING_S = 0.7  # motors run by then, and not yet to their end


def run(minutes: float, chance: random.Random, directory: Path) -> Seen:
    """Runs the daemon for so long, and tells what was seen of it."""
    broker = Mosquitto(directory / "mosquitto")
    broker.start()
    try:
        with house(chance) as built, TcpRelay(broker.port) as relay:
            configuration = Configuration(directory / "config.yaml", built, relay.port)
            configuration.write()
            write_shifts(directory / "shifts", 0.0, 0.0)
            return _Soak(minutes, built, broker, relay, configuration, directory, chance).run()
    finally:
        broker.stop()


def _daemon(directory: Path) -> Daemon:
    """The daemon in a process of its own, with a log."""
    wrapper = str(Path(counted_daemon.__file__).resolve())
    program = (wrapper, str(directory / "objects"), str(directory / "shifts"))
    return Daemon(directory / "config.yaml", program=program)


class _Soak:
    """One run. Used once, by the main thread."""

    def __init__(
        self,
        minutes: float,
        built: House,
        broker: Mosquitto,
        relay: TcpRelay,
        configuration: Configuration,
        directory: Path,
        chance: random.Random,
    ) -> None:
        self._seen = Seen(minutes)
        self._house = built
        self._directory = directory
        self._chance = chance
        self._ledger = Ledger(RULES)
        self._commander = Commander(broker.port, self._ledger, chance)
        self._upkeep = Upkeep(
            configuration, self._ledger, directory / "shifts", self._signal, chance
        )
        self._troubles = Troubles(
            built, self._commander, self._ledger, broker, relay, self._upkeep, chance
        )
        self._daemon = _daemon(directory)
        self._began = time.monotonic()

    @property
    def _process(self) -> Popen[bytes]:
        return self._daemon.process

    def _signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def run(self) -> Seen:
        """Storms and calms until the time is over, then the daemon is stopped and started."""
        seconds = self._seen.minutes * 60
        round_s = min(ROUND_S, seconds / ROUNDS_AT_LEAST)
        with self._daemon:
            self._calm(0.0)
            while self._elapsed() < seconds and self._process.poll() is None:
                self._storm(round_s * (1 - CALM_SHARE))
                self._calm(round_s * CALM_SHARE)
                self._look()
            self._end()
        if self._seen.ended is None:
            self._stops()
        self._report()
        return self._seen

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    # --- storm --------------------------------------------------------------------------------

    def _storm(self, lasts_s: float) -> None:
        self._trouble(lasts_s)
        self._troubles.undo_due(everything=True)

    def _trouble(self, lasts_s: float) -> None:
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
        """Return what is wrong at the moment; None: nothing."""
        if untrue := what_is_untrue(self._commander.states, self._house):
            return untrue
        if not self._ledger.link.whole:
            return "no ping came"
        return f"{self._ledger.waiting} verdicts are due" if self._ledger.waiting else None

    # --- looks --------------------------------------------------------------------------------

    def _look(self) -> None:
        self._judge()
        if self._process.poll() is not None:
            return
        sample = samples.take(self._process, self._directory / "objects", self._elapsed())
        self._seen.samples.append(sample)
        print(f"{sample}  commands {self._ledger.tally.sent}", flush=True)

    def _judge(self, *old_s: float) -> None:
        moves = [self._house.moves.popleft() for _ in range(len(self._house.moves))]
        self._ledger.judge(moves, time.monotonic(), *old_s)

    # --- stops --------------------------------------------------------------------------------

    def _end(self) -> None:
        seen, process = self._seen, self._process
        if process.poll() is not None:
            seen.ended = f"exit status {process.returncode} after {self._elapsed():.0f} s"
            seen.exit_status = process.returncode
        else:
            seen.cpu = samples.cpu_s(process) / self._elapsed()
            self._commander.move_all()
            self._wait(MOVING_S)
            seen.exit_status = self._stop()

    def _stops(self) -> None:
        """Motors run and troubles are on when it is stopped; then it is started again."""
        for _ in range(max(STOPS_AT_LEAST, round(STOPS_AN_HOUR * self._seen.minutes / 60))):
            self._troubles.undo_due(everything=True)
            with _daemon(self._directory) as self._daemon:
                self._ledger.link.mended(time.monotonic())
                self._calm(0.0)
                self._judge()
                self._commander.move_all()
                self._trouble(MOVING_S)
                for _ in range(self._chance.randint(0, 2)):
                    self._troubles.away()
                if self._process.poll() is None:
                    self._stop()
                else:
                    self._seen.stops.append(f"it ended before: {self._process.returncode}")
                    self._ledger.link.broken(time.monotonic())
        self._troubles.undo_due(everything=True)

    def _stop(self) -> int:
        """Tell it to end, and judge how it did."""
        at, logged = time.monotonic(), len(self._daemon.log)
        self._ledger.link.broken(at)
        self._upkeep.anew(LINES)
        self._process.send_signal(signal.SIGTERM)
        while self._process.poll() is None and time.monotonic() < at + STOP_S:
            self._tick()
        self._judge()
        self._ledger.relays.forget_losses()
        self._seen.stopped += 1
        status = self._process.poll()
        self._seen.stops += self._wrong_at_a_stop(status, at, self._daemon.log[logged:])
        return -1 if status is None else status

    def _wrong_at_a_stop(self, status: int | None, at: float, log: str) -> list[str]:
        """Return whether the exit status is true: 0 all motors stand, 1 those named may run."""
        left = sorted(self._ledger.relays.moving())
        told = [line for line in log.splitlines() if "may still move" in line]
        took_s = time.monotonic() - at
        quiet = all(self._ledger.disturbances.quiet(h.id, at - 1, at + took_s) for h in LIVE)
        text = f"{self._elapsed():.0f} s: exit status {status} after {took_s:.1f} s, ON: {left}"
        named = all(any(f"({name})" in line for line in told) for name, _ in left)
        fine = status == int(bool(told)) and named and not (told and quiet)
        return [] if fine else ["\n    ".join([text, *log.splitlines()[-8:]])]

    def _wait(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._tick()

    def _report(self) -> None:
        self._commander.close()
        self._commander.listen()
        self._judge(0.0)
        seen, log = self._seen, self._directory / "daemon.log"
        seen.tally, seen.troubles = self._ledger.tally, self._troubles.begun
        (self._directory / "troubles.log").write_text("\n".join(self._troubles.history) + "\n")
        seen.kinds = log_lines.kinds(log)
        seen.steady = log_lines.about(log, [home.id for home in DEAD])
        for home in DEAD:
            seen.starts[home.id] += self._upkeep.line_starts[home.line]
