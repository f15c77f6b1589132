"""Decides who may ask what. Every request passes here. Time is an argument: monotonic seconds."""

import hashlib
import hmac
import ipaddress
import secrets
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from urllib.parse import urlsplit

from bridge.config.schema import WebConfig
from bridge.config.web import is_address

SESSION_S = 7 * 86_400.0
MOST_SESSIONS = 64
# Wrong keys from one address: so many at once, then one each so often.
WRONG_KEYS, WRONG_KEY_EVERY_S = 5, 10.0
_MOST_ADDRESSES = 1024
_LOCAL_ENDINGS = (".local", ".lan", ".home.arpa", ".internal")


class Level(IntEnum):
    """What a key opens, and what a route asks for."""

    OPEN = 0  # no key: the files of the page and `/health`, which tell nothing of the house
    LOOK = 1
    SWITCH = 2


@dataclass(frozen=True, slots=True)
class Knock:
    """A request, as far as the door looks at it. Names of `headers` are in lower case."""

    address: str
    method: str
    headers: Mapping[str, str]
    session: str | None


@dataclass(frozen=True, slots=True)
class Denied:
    """Why a request is turned away: an HTTP status and a text for people."""

    status: int
    error: str


class Door:
    """The keys, the sessions, and who tried wrong keys. Only the thread of the panel uses it."""

    def __init__(self, web: WebConfig) -> None:
        self._keys = [
            (_digest(key), level)
            for key, level in (
                (web.password, Level.SWITCH),
                (web.token, Level.SWITCH),
                (web.read_token, Level.LOOK),
            )
            if key is not None
        ]
        # Without a password whoever reaches it is let in: that is this machine alone.
        self._without_key = Level.OPEN if web.password is not None else Level.SWITCH
        self._read_only = web.read_only
        self._proxy = web.proxy
        self._sessions: OrderedDict[str, tuple[float, Level]] = OrderedDict()
        self._wrong: OrderedDict[str, tuple[float, float]] = OrderedDict()  # left, at

    def objection(self, knock: Knock, wanted: Level, now: float) -> Denied | None:
        """Return why a request is turned away, or None."""
        if denied := _foreign(knock, behind_proxy=self._is_proxy(knock)):
            return denied
        if wanted is Level.OPEN:
            return None
        held = self._held(knock, now)
        if isinstance(held, Denied):
            return held
        if held < Level.LOOK:
            return Denied(401, "a password or a token is needed")
        if wanted > self.highest(held):
            return Denied(403, "this key, or this panel, is for looking only")
        return None

    def _is_proxy(self, knock: Knock) -> bool:
        return self._proxy is not None and knock.address == self._proxy

    def _client(self, knock: Knock) -> str:
        """Return who tries keys: of a proxy the last one that it names, else the other side."""
        named = knock.headers.get("x-forwarded-for", "").rpartition(",")[2].strip()
        return named if self._is_proxy(knock) and is_address(named) else knock.address

    def highest(self, held: Level) -> Level:
        """Return what may be done at the most by one who holds `held`."""
        return min(held, Level.LOOK) if self._read_only else held

    def level(self, knock: Knock, now: float) -> Level:
        """Return what one may do who was let in."""
        held = self._held(knock, now)
        return Level.OPEN if isinstance(held, Denied) else self.highest(held)

    def log_in(self, knock: Knock, key: str, now: float) -> str | Denied:
        """Return the session that a key opens."""
        held = self._level_of(self._client(knock), key, now)
        if isinstance(held, Denied):
            return held
        while self._sessions and len(self._sessions) >= MOST_SESSIONS:
            self._sessions.popitem(last=False)
        session = secrets.token_urlsafe(32)
        self._sessions[_digest(session).hex()] = now + SESSION_S, held
        return session

    def log_out(self, session: str) -> None:
        """End a session."""
        self._sessions.pop(_digest(session).hex(), None)

    def _held(self, knock: Knock, now: float) -> Level | Denied:
        scheme, _, token = knock.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self._level_of(self._client(knock), token.strip(), now)
        if knock.session:
            # Found by its digest: how long that takes tells nothing of the sessions that there are.
            ends, level = self._sessions.get(_digest(knock.session).hex(), (0.0, Level.OPEN))
            if now < ends:
                return level
        return self._without_key

    def _level_of(self, address: str, key: str, now: float) -> Level | Denied:
        """Compare with every key, in constant time."""
        address = _network(address)
        left, at = self._wrong.get(address, (float(WRONG_KEYS), now))
        left = min(WRONG_KEYS, left + (now - at) / WRONG_KEY_EVERY_S)
        if left < 1:
            return Denied(429, "too many wrong keys: wait a little")
        given, found = _digest(key), Level.OPEN
        for digest, level in self._keys:
            if hmac.compare_digest(digest, given):
                found = max(found, level)
        if found is Level.OPEN:
            self._wrong[address] = left - 1, now
            self._wrong.move_to_end(address)
            if len(self._wrong) > _MOST_ADDRESSES:
                self._wrong.popitem(last=False)
            return Denied(401, "a wrong key")
        return found


def _foreign(knock: Knock, *, behind_proxy: bool) -> Denied | None:
    """Turn away what another web site makes a browser ask (DNS rebinding, forged requests).

    A proxy takes requests under names of its own, and is reached under no others.
    """
    host = knock.headers.get("host", "")
    if not behind_proxy and not _is_ours(host):
        return Denied(421, "call the panel by an IP address, localhost or a name without a domain")
    if knock.method in {"GET", "HEAD"}:
        return None
    if knock.headers.get("content-type", "").split(";")[0].strip() != "application/json":
        return Denied(415, "send application/json")
    site = knock.headers.get("sec-fetch-site")
    origin = knock.headers.get("origin")
    if site is not None:
        is_foreign = site not in {"same-origin", "none"}
    else:
        is_foreign = origin is not None and _authority(origin) != host.lower()
    return Denied(403, "this request comes from another site") if is_foreign else None


def _is_ours(host: str) -> bool:
    """Return whether a stranger cannot have this name point to us."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    name = name.rstrip(".")
    return is_address(name) or (bool(name) and "." not in name) or name.endswith(_LOCAL_ENDINGS)


def _authority(origin: str) -> str:
    return origin.lower().partition("://")[2]


def _network(address: str) -> str:
    """Return what one client has: of IPv6 that is a whole network of addresses."""
    if ":" not in address:
        return address
    return ipaddress.IPv6Address(address.partition("%")[0]).exploded[:19]


def _digest(key: str) -> bytes:
    return hashlib.sha256(key.encode("utf-8", errors="replace")).digest()
