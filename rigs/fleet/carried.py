"""What one mosquitto carries: many bridges on it, from nothing, over its restart, after a birth."""

import getpass
import logging
import os
import random
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe

from fleet.bridges import LINES, MODULES, STATUS, OneBridge, Traffic

GIVE_UP_S = 900.0
STEADY_S = 20.0
QUIET_S = 3.0
_TICKS = os.sysconf("SC_CLK_TCK")
Tell = Callable[[str], None]


class _Broker(Mosquitto):
    """Debian's configuration and a listener: kept on disk, and no log of each message."""

    def __init__(self, directory: Path, queued: int) -> None:
        super().__init__(directory)
        self._queued = queued

    def _configuration(self) -> list[str]:
        return [
            f"user {getpass.getuser()}",
            "persistence true",
            f"persistence_location {self.directory}/",
            f"log_dest file {self.directory}/mosquitto.log",
            "allow_anonymous true",
            f"max_queued_messages {self._queued}",
            f"listener {self.port} 127.0.0.1",
        ]

    @property
    def pid(self) -> int:
        """Its process."""
        assert self._process is not None
        return self._process.pid


class _Fleet:
    """So many bridges at one broker. One thread turns them all."""

    def __init__(self, broker: _Broker, amount: int, tell: Tell) -> None:
        self.traffic = Traffic()
        self._amount = amount
        self._broker = broker
        self._tell = tell
        self._bridges = [OneBridge(n, broker.port, self.traffic) for n in range(amount)]

    def measure(self) -> None:
        """Print a line for each thing that happens to the fleet."""
        self._row("a cold start", self._start)
        self._new_client()
        self._row(f"{STEADY_S:.0f} s of changes", lambda: self._steady(random.Random(1)))  # noqa: S311
        self._row("a birth", self._birth)
        self._row("a restart of the broker", self._broker.restart)

    def stop(self) -> None:
        """End all of them."""
        for bridge in self._bridges:
            bridge.stop()

    def _row(self, name: str, begin: Callable[[], None]) -> None:
        messages, octets = self.traffic.messages, self.traffic.octets
        connections = self._connections()
        own, began = _cpu_s(os.getpid()), time.monotonic()
        broker_pid, broker = self._broker.pid, _cpu_s(self._broker.pid)
        begin()
        self._until_all_is_there()
        took_s = time.monotonic() - began
        pid = self._broker.pid  # after a restart another one, which counts from nothing
        broker_s = _cpu_s(pid) - (broker if pid == broker_pid else 0.0)
        self._tell(
            f"{name:<24}{took_s:7.1f} s {self.traffic.messages - messages:>9} messages "
            f"{(self.traffic.octets - octets) / 1e6:7.1f} MB; broker {broker_s:6.1f} s of CPU, "
            f"{_rss_mb(pid):5.0f} MB; a bridge "
            f"{(_cpu_s(os.getpid()) - own) / self._amount:6.2f} s of CPU; "
            f"{self._connections() - connections} connections"
        )

    def _connections(self) -> int:
        return sum(bridge.connections for bridge in self._bridges)

    def _start(self) -> None:
        for bridge in self._bridges:
            bridge.start()

    def _birth(self) -> None:
        with MqttProbe(self._broker.port) as probe:
            probe.publish(STATUS, "online")
        self._turn_for(2.5)  # each bridge waits up to 2 s

    def _steady(self, chance: random.Random) -> None:
        for _ in range(int(STEADY_S)):
            for bridge in self._bridges:
                bridge.change(chance)
            self._turn_for(1.0)

    def _turn_for(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._turn()

    def _turn(self) -> None:
        for bridge in self._bridges:
            bridge.turn()
        time.sleep(0.002)

    def _until_all_is_there(self) -> None:
        give_up = time.monotonic() + GIVE_UP_S
        with MqttProbe(self._broker.port, "+/+/bridge/state") as probe:
            while not (all(b.drained for b in self._bridges) and self._online(probe)):
                assert time.monotonic() < give_up, f"not all is there after {GIVE_UP_S:.0f} s"
                self._turn()

    def _online(self, probe: MqttProbe) -> bool:
        latest = {message.topic: message.text for message in probe.seen}
        return list(latest.values()).count("online") == self._amount

    def _new_client(self) -> None:
        """Count what a new client gets that asks for everything, until no more comes."""
        sizes = self._broker.directory / "sizes"
        command = ["mosquitto_sub", "-p", f"{self._broker.port}", "-t", "#", "-F", "%l"]
        with sizes.open("wb") as output:
            began = last = time.monotonic()
            process = subprocess.Popen([*command, "--retained-only"], stdout=output)
            written = 0
            while time.monotonic() < last + QUIET_S:
                self._turn()
                if written != (written := sizes.stat().st_size):
                    last = time.monotonic()
            process.terminate()
            process.wait()
        found = [int(size) for size in sizes.read_text().split()]
        self._tell(
            f"{'a new client':<24}{last - began:7.1f} s {len(found):>9} messages "
            f"{sum(found) / 1e6:7.1f} MB: all that is retained"
        )


def run_fleet(directory: Path, amount: int, queued: int, tell: Tell) -> bool:
    """Measure so many bridges at one broker, which lets so many messages wait for a client."""
    logging.getLogger().addHandler(logging.NullHandler())  # a slow start is no news here
    broker = _Broker(directory / f"mosquitto{amount}", queued)
    with ExitStack() as stack:
        stack.callback(broker.stop)
        broker.start()
        stack.enter_context(_home_assistant(broker.port))
        before_mb = _rss_mb(os.getpid())
        fleet = _Fleet(broker, amount, tell)
        stack.callback(fleet.stop)
        stations = amount * LINES * MODULES
        tell(f"{amount} bridges, {stations} stations, {stations * 24} channels")
        fleet.measure()
        tell(f"{'':<24}a bridge has {(_rss_mb(os.getpid()) - before_mb) / amount:.0f} MB")
    return True


@contextmanager
def _home_assistant(port: int) -> Iterator[None]:
    """One client that hears everything, as Home Assistant does, over a restart too."""
    program = shutil.which("mosquitto_sub")
    assert program is not None, "mosquitto_sub is not installed (apt install mosquitto-clients)"
    process = subprocess.Popen([program, "-p", f"{port}", "-t", "#"], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def _rss_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
