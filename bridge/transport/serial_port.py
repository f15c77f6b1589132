"""Serial ports, here and behind an RFC 2217 server. The only importer of pyserial."""

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
# Not a matter of rights on the file: a filter of systemd's stands before it.
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
# A port that vanishes makes pyserial raise any of these; termios.error is no OSError.
_TROUBLE = (OSError, termios.error, ValueError, TypeError)
# pyserial's RFC 2217 client waits in slices of this length; between them we see our deadline.
_SLICE_S = 0.01
_LONGEST_WRITE_S = 1.0


def open_serial(path: str, baud: int) -> Port:
    """Open a serial device with 8N1, for this process alone.

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
    # flock keeps out those who ask for it, TIOCEXCL everybody but root. FTDI chips hold bytes
    # back for 16 ms unless told; other adapters know no such mode. A port that vanished
    # meanwhile says so at the first read.
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
    # We use no control lines, and some servers never answer a request for them.
    option = "" if "ign_set_control" in url else ("&" if "?" in url else "?") + "ign_set_control"
    try:
        device = serial.serial_for_url(url + option, baud, timeout=_SLICE_S)
    except _TROUBLE as error:
        raise PortError(f"{url}: {error}: is the server up, and its port free?") from error
    # pyserial hides its socket; without this it leaks after a hang-up, a write may
    # block for 5 s, and a dead link goes unnoticed for a quarter of an hour.
    connection: socket.socket = vars(device)["_socket"]
    give_up_early(connection)
    connection.settimeout(_LONGEST_WRITE_S)
    return Rfc2217Port(url, device, connection, release)


class Rfc2217Port:
    """A Port over pyserial's RFC 2217 client. One thread owns it.

    pyserial negotiates the line anew whenever its time-out is changed. So that one stays short,
    and the deadlines are kept here.
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
        """Return exactly `count` bytes, or fewer when the deadline comes first."""
        data = self._take(count)
        while len(data) < count and boot_s() < deadline:
            data += self._take(count - len(data))
        return data

    def write(self, data: bytes, deadline: float) -> None:  # noqa: ARG002 - see _LONGEST_WRITE_S
        """Hand all of `data` to the line, or raise PortError within a second."""
        try:
            self._device.write(data)
        except _TROUBLE as error:
            raise self._gone(error) from error

    def discard(self) -> bytes:
        """Take what waits in the input without waiting, and return it as evidence."""
        try:
            waiting = self._device.in_waiting
        except _TROUBLE as error:
            raise self._gone(error) from error
        return self._take(waiting) if waiting else b""

    def close(self) -> None:
        """Give the connection back. May be called twice."""
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
    # Bytes that cannot leave would hold up the closing for half a minute.
    with suppress(*_TROUBLE):
        termios.tcflush(descriptor, termios.TCIOFLUSH)
    # The lock lasts as long as anybody has the device open, not as long as we do.
    with suppress(*_TROUBLE):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
    with suppress(*_TROUBLE):
        device.close()
