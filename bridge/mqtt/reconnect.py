"""Decides after a connection ended: the pause, the next protocol, and the log message.

No I/O and no clock: the client says how a connection ended and how long it lasted.
"""

import random
from dataclasses import dataclass
from enum import Enum, auto

from bridge.config.schema import MqttConfig, TlsConfig


@dataclass(frozen=True, slots=True)
class Backoff:
    """Deadlines and pauses of the client, in seconds.

    Attributes:
        attempt_s: From the TCP connection to the granted subscriptions. The TCP connection and the
            TLS handshake have the same time each.
        first_s: The pause after the first failure; each further failure doubles it.
        longest_s: The longest pause: we are connected within 12 s of the start of the broker.
        longest_of_cluster_s: The same between the rounds over several servers. A cluster elects a
            leader first, for up to 9 s: until then it refuses us.
        jitter: The random part of a pause, so that the clients of a broker do not all come back at
            the same instant. It only shortens the pause.
        lasting_s: After a connection of this length, or one that was cut, the pauses begin at
            `first_s` again. After one that the broker closed, the length has to be over
            `longest_s`: else two clients with one id would reset the pause at each turn on 3.1.1.
        taken_over_s: The pause after another client took over our id (docs/failures.md B4).
    """

    attempt_s: float = 5.0
    first_s: float = 1.0
    longest_s: float = 10.0
    longest_of_cluster_s: float = 3.0
    jitter: float = 0.2
    lasting_s: float = 30.0
    taken_over_s: float = 60.0


class Ending(Enum):
    """The end of a connection, by what happens next."""

    STOPPED = auto()  # we ended it
    UNREACHABLE = auto()  # no MQTT broker answered
    VERSION = auto()  # the broker refused the protocol version
    NO_ANSWER = auto()  # it closed or stayed silent: it may not know the protocol, or be stopping
    CREDENTIALS = auto()  # wrong username or password
    REFUSED = auto()  # refused for another reason
    TAKEN_OVER = auto()  # another client uses our id
    HUNG_UP = auto()  # it was accepted; then the broker closed it without a reason
    NOT_SUBSCRIBED = auto()  # it was accepted, and closed before SUBACK
    TOO_LARGE = auto()  # it was closed at one message
    LOST = auto()  # it was accepted, and cut
    LEFT = auto()  # we left it for another server


@dataclass(frozen=True, slots=True)
class Ended:
    """The end of a connection: the evidence, and advice if there is any."""

    ending: Ending
    cause: str
    advice: str = ""


_HANG_UPS = 3  # as many in a row are no accident


class ReconnectPlan:
    """The pauses and the protocol of one client. One thread owns it.

    Attributes:
        protocol: "5" or "3.1.1": the protocol of the next attempt.
    """

    def __init__(self, configured: str, backoff: Backoff, *, is_cluster: bool = False) -> None:
        self.protocol = "5" if configured == "auto" else configured
        self._auto = configured == "auto"
        self._proven = self.protocol
        self._guessed = False  # the protocol is a guess, because the last one got no answer
        self._backoff = backoff
        self._next_s = backoff.first_s
        longest_s = backoff.longest_s
        self._longest_s = min(longest_s, backoff.longest_of_cluster_s) if is_cluster else longest_s
        self._hang_ups = 0

    def connected(self) -> None:
        """Record that the broker accepted us: this protocol is tried first from now on.

        Exception: after 5 got no answer at all. Behind a proxy this happens while a broker starts,
        and 3.1.1 gives fewer guarantees.
        """
        if not self._guessed:
            self._proven = self.protocol

    def judge(self, ended: Ended, lasted_s: float) -> Ended:
        """Return the end; several hang-ups in a row count as a second client with our id.

        MQTT 3.1.1 cannot report a session that was taken over, and mosquitto before 2.0.15 does not
        report it on 5 either. Two bridges that each wait `taken_over_s` hold a connection for that
        time, so only a connection of twice this length proves that the conflict is over.
        """
        soon = lasted_s < 2 * self._backoff.taken_over_s
        hung_up = ended.ending is Ending.HUNG_UP and soon
        self._hang_ups = self._hang_ups + 1 if hung_up else 0
        if self._hang_ups < _HANG_UPS:
            return ended
        return Ended(Ending.TAKEN_OVER, f"{ended.cause}, {_HANG_UPS} times in a row and more")

    @property
    def tries_other(self) -> bool:
        """Tell whether the next attempt is the same one in the other protocol."""
        return self.protocol != self._proven

    def pause_after(self, ending: Ending, lasted_s: float, *, has_more: bool = False) -> float:
        """Choose the next protocol and return the pause before it; 0: try the other at once.

        Args:
            ending: How the connection ended.
            lasted_s: How long it was there.
            has_more: Another server is tried at once; the pause comes when the round is over.
        """
        fails_to_agree = ending in (Ending.VERSION, Ending.NO_ANSWER)
        if fails_to_agree and self._auto and self.protocol == self._proven:
            self._guessed = ending is Ending.NO_ANSWER
            self.protocol = "3.1.1" if self.protocol == "5" else "5"
            return 0.0
        # Both were refused, or the broker went away meanwhile, which says nothing about versions.
        self.protocol = self._proven
        self._guessed = False
        if ending is Ending.TAKEN_OVER:
            return self._backoff.taken_over_s
        if has_more or ending is Ending.LEFT:
            return 0.0
        if ending is Ending.CREDENTIALS:
            return self._backoff.longest_s
        return self._growing_pause(
            afresh=ending in (Ending.LOST, Ending.TOO_LARGE) or lasted_s >= self._backoff.lasting_s
        )

    def _growing_pause(self, *, afresh: bool) -> float:
        if afresh:
            self._next_s = self._backoff.first_s
        pause_s = self._next_s
        self._next_s = min(2 * pause_s, self._longest_s)
        return pause_s * (1 - self._backoff.jitter * random.random())  # noqa: S311  # no secret


def explain(ended: Ended, config: MqttConfig, pause_s: float) -> str:
    """Return one line: what happened, and what the reader can do."""
    where = f"the broker at {config.host}:{config.port}"
    cause = ended.cause
    match ended.ending:
        case Ending.UNREACHABLE | Ending.REFUSED:
            return f"no connection to {where}: {cause}; {ended.advice or _suspect(cause)}"
        case Ending.VERSION | Ending.NO_ANSWER if config.protocol == "auto":
            return f"{where} takes neither MQTT 5 nor 3.1.1: {cause}; {_guess(config.tls)}"
        case Ending.VERSION | Ending.NO_ANSWER:
            slow = ", or is too slow" if ended.ending is Ending.NO_ANSWER else ""
            return f"{where} does not take MQTT {config.protocol}{slow}: {cause}; see mqtt.protocol"
        case Ending.CREDENTIALS:
            check = "check mqtt.username and mqtt.password"
            user = (
                "clients without a username"
                if config.username is None
                else f"user {config.username!r}"
            )
            return f"{where} refuses {user}: {cause}; {check}"
        case Ending.TAKEN_OVER:
            other = f"another client seems to use the client id {config.client_id!r}"
            advice = f"stop it or set mqtt.client_id; waiting {pause_s:.0f} s"
            return f"lost {where}: {cause}: {other}; {advice}"
        case _:
            advice = f"; {ended.advice}" if ended.advice else ""
            return f"lost {where}: {cause}{advice}"


def _suspect(cause: str) -> str:
    """Return what to check when no connection was established."""
    if "[SSL: " in cause:  # the mark of OpenSSL
        return "check mqtt.tls, and that mqtt.port is its port for TLS"
    return "check that it runs, and mqtt.host and mqtt.port"


def _guess(tls: TlsConfig | None) -> str:
    """Return what a broker that hangs up may require.

    With TLS 1.3 it hangs up only after the handshake.
    """
    if tls is None:
        return "does it want TLS?"
    if tls.cert is None:
        return "does it want a certificate of ours (mqtt.tls.cert)?"
    return "does it speak MQTT on that port?"
