"""What `check --live` tries: the broker, each port, and each station on it. It only reads."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.cli.through_broker.broker import at_broker
from bridge.clock import boot_s
from bridge.commission.visit import NotMetError, meet
from bridge.config.load import load_config
from bridge.config.schema import Config, LineConfig
from bridge.errors import BridgeError, ConfigError, PortBusyError, PortError
from bridge.line.station import Station
from bridge.model import Learned
from bridge.mqtt.events import Subscription
from bridge.mqtt.topics import Topics
from bridge.transport.bus import Bus, bus_of
from bridge.transport.opener import open_port

_BROKER_S = 5.0


@dataclass(frozen=True, slots=True)
class Trial:
    """Describe one thing that was tried, and what came of it."""

    what: str
    ok: bool
    told: str

    def __str__(self) -> str:
        return f"{self.what}: {self.told}"

    @property
    def document(self) -> dict[str, Any]:
        """Return the time for programs."""
        return {"what": self.what, "ok": self.ok, "told": self.told}


def trials(path: Path, config: Config) -> Iterator[Trial]:
    """Try one thing after the other, and yield what came of it."""
    yield _broker(path)
    for line in config.lines:
        yield from _line(line)


def _broker(path: Path) -> Trial:
    try:
        mqtt = load_config(path, os.environ).mqtt
        bridge_state = Subscription(Topics(mqtt.base_topic).bridge_state, live_only=False)
        with at_broker(mqtt, "check", (bridge_state,), _BROKER_S):
            return Trial("broker", ok=True, told=f"{mqtt.host}:{mqtt.port} takes us")
    except ConfigError as error:
        return Trial("broker", ok=False, told=error.problems[0].message)
    except BridgeError as error:
        return Trial("broker", ok=False, told=str(error))


def _line(line: LineConfig) -> Iterator[Trial]:
    name = f"line {line.id}"
    try:
        port = open_port(line.port, line.baud)
    except PortBusyError as error:
        told = f"{error}; if that is the bridge, `wisco2mqtt watch` shows what it reads"
        yield Trial(name, ok=False, told=told)
        return
    except PortError as error:
        yield Trial(name, ok=False, told=str(error))
        return
    yield Trial(name, ok=True, told=f"{line.port} opens")
    try:
        bus = bus_of(line, port)
        bus.await_silence()
        for config in line.stations:
            yield _station(Station(config, line), line, bus)
    except PortError as error:
        yield Trial(name, ok=False, told=str(error))
    finally:
        port.close()


def _station(station: Station, line: LineConfig, bus: Bus) -> Trial:
    name = f"station {station.config.id}"
    try:
        meet(station, line, bus, boot_s)
    except NotMetError as error:
        return Trial(name, ok=False, told=str(error))
    times = _learned(bus.learned(station.config.address))
    return Trial(name, ok=True, told=f"a {station.config.model.name} answers{times}")


def _learned(learned: Learned) -> str:
    """Return the times of a module that `auto` gave it here, as the end of a line."""
    times = {
        "turnaround": learned.turnaround_s,
        "late_window": learned.late_window_s,
        "silence": learned.silence_s,
    }
    told = [f"{name} {s * 1000:.1f} ms" for name, s in times.items() if s is not None]
    return f"; auto: {', '.join(told)}" if told else ""
