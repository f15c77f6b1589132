"""The locks that `run` takes before it contacts anything: base topic and ports."""

import os
from collections.abc import Iterable
from typing import Self

from bridge.config.schema import LineConfig
from bridge.errors import PortBusyError, PortError
from bridge.transport.lock import Lock, LockHeldError, take_lock
from bridge.transport.opener import is_gateway, open_port, take_port_lock
from bridge.transport.port import Port

# Bridges with different values here do not see each other's base topics. Tests use this to run many
# at a time, each at its own broker.
SCOPE_VARIABLE = "WISCO2MQTT_LOCK_SCOPE"


class BaseTopicLocks:
    """Locks of base topics: one bridge for each on a machine. Only the main thread uses it."""

    def __init__(self) -> None:
        self._held: dict[str, Lock] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.keep(None)

    def acquire(self, base_topic: str) -> None:
        """Take the lock of a base topic; held locks are kept.

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
        """Release all locks except that of `base_topic`; None: all."""
        for other in [held for held in self._held if held != base_topic]:
            self._held.pop(other).release()


class StartPorts:
    """The ports of a start: opened before the broker is contacted, then passed to their lines.

    The main thread calls `acquire` before any line is started; then the thread of each line opens
    its port.
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

    def acquire(self, lines: Iterable[LineConfig]) -> None:
        """Open the devices and lock the gateways; a missing device may come later.

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
        """Return the port that was taken; from the second call on open the port normally."""
        port = self._ports.pop(url, None)
        return port or open_port(url, baud, self._locks.pop(url, None))
