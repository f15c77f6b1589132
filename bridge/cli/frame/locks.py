"""What `run` takes before it contacts anything: its base topic, and the ports of its lines."""

import os
from collections.abc import Iterable
from typing import Self

from bridge.config.schema import LineConfig
from bridge.errors import PortBusyError, PortError
from bridge.transport.lock import Lock, LockHeldError, take_lock
from bridge.transport.opener import is_gateway, open_port, take_port_lock
from bridge.transport.port import Port

# Bridges with different words here do not see each other's base topics: for tests, which run many
# at a time, each at a broker of its own.
SCOPE_VARIABLE = "WISCO2MQTT_LOCK_SCOPE"


class BaseTopicLocks:
    """One bridge a base topic and machine. Only the main thread uses it."""

    def __init__(self) -> None:
        self._held: dict[str, Lock] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.keep(None)

    def take(self, base_topic: str) -> None:
        """Take the lock of a base topic, besides those that are held.

        Raises:
            LockHeldError: Another bridge has it.
        """
        if base_topic in self._held:
            return
        scope = os.environ.get(SCOPE_VARIABLE, "")
        try:
            self._held[base_topic] = take_lock(f"base topic {base_topic} {scope}".rstrip())
        except LockHeldError as error:
            raise LockHeldError(
                f"another bridge runs on this machine with the base topic {base_topic}: "
                "stop that one first, or give this one another base_topic"
            ) from error

    def keep(self, base_topic: str | None) -> None:
        """Give all locks back but that of `base_topic`; None: all."""
        for other in [held for held in self._held if held != base_topic]:
            self._held.pop(other).release()


class StartPorts:
    """The ports of a start, taken before the broker is contacted, and handed to their lines.

    `take` belongs to the main thread, before any line is started; each port is then opened by the
    thread of its line.
    """

    def __init__(self) -> None:
        self._ports: dict[str, Port] = {}
        self._locks: dict[str, Lock] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for port in self._ports.values():
            port.close()
        for lock in self._locks.values():
            lock.release()

    def take(self, lines: Iterable[LineConfig]) -> None:
        """Open the devices and lock the gateways; what is absent may come later.

        Raises:
            PortBusyError: Another program on this machine has one of them.
        """
        for line in lines:
            try:
                if is_gateway(line.port):
                    self._locks[line.port] = take_port_lock(line.port)
                else:
                    self._ports[line.port] = open_port(line.port, line.baud)
            except PortBusyError as error:
                raise PortBusyError(f"line {line.id}: {error}") from error
            except PortError:
                continue

    def open(self, url: str, baud: int) -> Port:
        """Hand over what was taken; afterwards open the port as ever."""
        port = self._ports.pop(url, None)
        return port or open_port(url, baud, self._locks.pop(url, None))
