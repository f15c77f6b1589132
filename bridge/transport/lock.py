"""Locks that every program on this machine sees, and that end with the process that holds them.

A lock is a name in the abstract namespace of Unix sockets. It needs no file and no permission, so
root, a user and a sandboxed service (DynamicUser, PrivateTmp) see the same lock. The kernel
releases it, however the process ends. A container with its own network does not see it.
"""

import errno
import hashlib
import socket
from typing import Self

from bridge.errors import BridgeError

_PREFIX = b"\0wisco2mqtt "  # as `ss -xl` shows them
_LONGEST_NAME = 90  # bytes, so that it fits with the prefix: the kernel takes 107


class LockHeldError(BridgeError):
    """Another program on this machine, or another part of this one, has the lock."""


class Lock:
    """A lock that this process holds until `release`, or until it ends."""

    def __init__(self, held: socket.socket) -> None:
        self._held = held

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the lock. May be called twice."""
        self._held.close()


def take_lock(name: str) -> Lock:
    """Take the lock with this name.

    Raises:
        LockHeldError: It is taken.
        BridgeError: This system has no such locks; the message says why.
    """
    held = None
    try:
        held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        held.bind(_abstract(name))  # it never listens, so no client can connect
    except OSError as error:
        if held is not None:
            held.close()
        if error.errno == errno.EADDRINUSE:
            raise LockHeldError(f"{name}: locked by another program on this machine") from error
        raise BridgeError(
            f"{name}: no lock can be had ({error.strerror}): are Unix sockets allowed here?"
        ) from error
    return Lock(held)


def _abstract(name: str) -> bytes:
    text = name.encode()
    if len(text) > _LONGEST_NAME:
        text = hashlib.sha256(text).hexdigest().encode()
    return _PREFIX + text
