"""Serial ports: local ones, and those behind an RFC 2217 server.

Only this file imports pyserial.
"""

import errno
import fcntl
import os
import socket
import termios
from collections.abc import Callable
from contextlib import suppress

import serial

from bridge.clock import boot_s
from bridge.errors import PortBusyError, PortError
from bridge.transport.descriptor import DescriptorPort
from bridge.transport.port import Port
from bridge.transport.tcp import give_up_early

_PLUGGED_IN = "no such device: is the adapter plugged in?"
_HELD = "another program holds it: stop that one first"
_DENIED = "permission denied: add the user to the group dialout"
# This is not about file permissions: a filter of systemd blocks the device.
_FORBIDDEN = (
    "not permitted: is the device in DeviceAllow= of the systemd unit? If it is, its driver was "
    "loaded later: restart the service"
)
_ADVICE = {
    errno.ENOENT: _PLUGGED_IN,
    errno.ENODEV: _PLUGGED_IN,
    errno.ENXIO: _PLUGGED_IN,
    errno.EACCES: _DENIED,
    errno.EPERM: _FORBIDDEN,
    errno.EBUSY: _HELD,  # TIOCEXCL
    errno.EWOULDBLOCK: _HELD,  # flock
}
_BUSY = frozenset({errno.EBUSY, errno.EWOULDBLOCK})
# A port that vanishes makes pyserial raise any of these; termios.error is not an OSError.
_TROUBLE = (OSError, termios.error, ValueError, TypeError)
# The RFC 2217 client of pyserial waits in slices of this length; we check our deadline between
# them.
_SLICE_S = 0.01
_LONGEST_WRITE_S = 1.0


def open_serial(path: str, baud: int) -> Port:
    """Open a serial device with 8N1, exclusively.

    Raises:
        PortBusyError: Another program holds it.
        PortError: It cannot be opened; the message says what to do.
    """
    try:
        device = serial.Serial(path, baud, exclusive=True)
    except _TROUBLE as error:
        kind = PortBusyError if getattr(error, "errno", None) in _BUSY else PortError
        raise kind(f"{path}: {_advice(error)}") from error
    descriptor = device.fileno()
    os.set_blocking(descriptor, False)
    # flock keeps out programs that ask for it, TIOCEXCL all but root. FTDI chips hold bytes for 16
    # ms unless they are told not to; other adapters do not have this mode. If the port vanished
    # meanwhile, the first read reports it.
    with suppress(*_TROUBLE):
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    with suppress(*_TROUBLE):
        device.set_low_latency_mode(True)
    return DescriptorPort(
        path,
        descriptor,
        lambda: _release(device),
        gone="the device hung up: is the adapter still plugged in?",
    )


def open_rfc2217(url: str, baud: int, release: Callable[[], None] = lambda: None) -> Port:
    """Open a serial port behind an RFC 2217 server, with 8N1.

    `release` is called once the port is closed.

    Raises:
        PortError: It cannot be opened; the message says what to do.
    """
    # We use no control lines, and some servers never answer requests about them.
    option = "" if "ign_set_control" in url else ("&" if "?" in url else "?") + "ign_set_control"
    try:
        device = serial.serial_for_url(url + option, baud, timeout=_SLICE_S)
    except _TROUBLE as error:
        raise PortError(f"{url}: {error}: is the server up, and its port free?") from error
    # pyserial hides its socket. Without this it leaks after a hang-up, a write may block for 5 s,
    # and a dead link is not noticed for a quarter of an hour.
    connection: socket.socket = vars(device)["_socket"]
    give_up_early(connection)
    connection.settimeout(_LONGEST_WRITE_S)
    return Rfc2217Port(url, device, connection, release)


class Rfc2217Port:
    """A Port over the RFC 2217 client of pyserial. One thread owns it.

    pyserial negotiates the line again at each change of its time-out. So its time-out stays short,
    and this class keeps the deadlines.
    """

    def __init__(
        self,
        name: str,
        device: serial.Serial,
        connection: socket.socket,
        release: Callable[[], None],
    ) -> None:
        self._name = name
        self._device = device
        self._connection = connection
        self._release = release

    @property
    def name(self) -> str:
        """Return the port as the configuration writes it."""
        return self._name

    def read(self, count: int, deadline: float) -> bytes:
        """Return exactly `count` bytes, or fewer at the deadline."""
        data = self._take(count)
        while len(data) < count and boot_s() < deadline:
            data += self._take(count - len(data))
        return data

    def write(self, data: bytes, deadline: float) -> None:  # noqa: ARG002 - see _LONGEST_WRITE_S
        """Write all of `data`, or raise PortError within a second."""
        try:
            self._device.write(data)
        except _TROUBLE as error:
            raise self._gone(error) from error

    def discard(self) -> bytes:
        """Drop the waiting input without waiting for more; return it as evidence."""
        try:
            waiting = self._device.in_waiting
        except _TROUBLE as error:
            raise self._gone(error) from error
        return self._take(waiting) if waiting else b""

    def close(self) -> None:
        """Close the connection. May be called twice."""
        with suppress(*_TROUBLE):
            self._device.close()
        self._connection.close()
        self._release()

    def _take(self, count: int) -> bytes:
        try:
            return self._device.read(count)
        except _TROUBLE as error:
            raise self._gone(error) from error

    def _gone(self, error: Exception) -> PortError:
        return PortError(f"{self._name}: {error}: is the server up, and its port free?")


def _advice(error: Exception) -> str:
    code = getattr(error, "errno", None) or 0
    return _ADVICE.get(code, f"not usable as a serial port: {error}")


def _release(device: serial.Serial) -> None:
    """Close a device that may have vanished."""
    descriptor = device.fileno()
    # Bytes that cannot be sent would delay the close for half a minute.
    with suppress(*_TROUBLE):
        termios.tcflush(descriptor, termios.TCIOFLUSH)
    # The lock lasts as long as any process has the device open.
    with suppress(*_TROUBLE):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
    with suppress(*_TROUBLE):
        device.close()
