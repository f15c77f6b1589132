"""Choose which server of a cluster is tried next. A clock and a socket are nowhere here."""

import socket
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bridge.config.schema import Server


@dataclass(frozen=True, slots=True)
class Candidate:
    """One address of one server.

    Attributes:
        server: As the configuration names it, which is the name in its certificate too.
        address: An IP address of that name; None: the name could not be looked up.
    """

    server: Server
    address: str | None


Resolve = Callable[[Server], Sequence[str]]


def addresses_of(server: Server) -> list[str]:
    """Look up the IP addresses of a server, in the order of the system's resolver; [] without."""
    try:
        found = socket.getaddrinfo(server.host, server.port, type=socket.SOCK_STREAM)
    except (OSError, ValueError):  # ValueError: it is no name at all
        return []
    return list(dict.fromkeys(str(address[0]) for *_, address in found))


class ServerTurn:
    """Take the servers in turn, the one that worked last first. One thread owns it.

    A round takes each address of each server once. The names are looked up at its beginning.
    """

    def __init__(self, servers: Sequence[Server], resolve: Resolve = addresses_of) -> None:
        self._servers = servers
        self._resolve = resolve
        self._left: deque[Candidate] = deque()
        self._known: set[Candidate] = set()  # those of the newest round
        self._mute: set[Candidate] = set()  # left because they were mute
        self._first: Candidate | None = None

    @property
    def has_more(self) -> bool:
        """Tell whether the round goes on with another address."""
        return bool(self._left)

    def next(self) -> Candidate:
        """Return what is to be tried now. Blocks for the deadlines of the resolver."""
        if not self._left:
            self._left.extend(self._round())
            self._known = set(self._left)
        return self._left.popleft()

    def worked(self, candidate: Candidate) -> None:
        """Begin the next round with this one: it took us."""
        self._first = candidate
        self._left.clear()

    def leave(self, candidate: Candidate, *, was_good: bool) -> bool:
        """Return whether to leave a server that took us and is mute: another may be better.

        If all others were mute too, stay; when it is asked a second time, try them again.

        Args:
            candidate: The server.
            was_good: It had worked for a while.
        """
        if was_good or candidate in self._mute:
            self._mute.clear()
        self._mute.add(candidate)
        if self._known <= self._mute:
            return False
        self._first = None
        return True

    def _round(self) -> list[Candidate]:
        found: list[Candidate] = []
        for server in self._servers:
            addresses: Sequence[str | None] = self._resolve(server) or (None,)
            found.extend(Candidate(server, address) for address in addresses)
        # `sorted` keeps the order of those that are equal.
        return sorted(found, key=lambda each: (each in self._mute, each != self._first))
