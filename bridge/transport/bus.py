"""One conversation on a half-duplex line: a request out, its reply in, and silence between."""

import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from bridge.clock import boot_s
from bridge.errors import BadReplyError, ExchangeError, ExpiredError, NoReplyError, RefusedError
from bridge.protocol.request import Request
from bridge.transport.habits import Habits
from bridge.transport.port import Port
from bridge.transport.tap import Hear, TappedPort
from bridge.transport.timing import LineTiming, sleep_exactly

T = TypeVar("T")

# A line is quiet after a few characters of silence; USB adapters hold bytes back for 16 ms.
_QUIET_CHARS = 5
_LEAST_QUIET_S = 0.02
# A line that never falls quiet must not hold its thread.
_LONGEST_DRAIN_S = 0.2
_DRAIN_CHUNK = 4096
# A gateway that is still saying what it held back is waited for, but not for ever.
_LONGEST_SETTLING_S = 2.0
_EVIDENCE_BYTES = 16
# What a module may say behind the CR of a Wisco reply (docs/protocol.md, reading line-end).
_LINE_FEED = b"\n"
_LINE_FEED_CHARS = 3  # that, and as much again for the module to hear us


class IncompleteReplyError(BadReplyError):
    """A reply began and did not end in time: the rest of it may come yet."""


class EchoDamagedError(BadReplyError):
    """Our own bytes came back, and not as they were sent."""


@dataclass(slots=True)
class BusCounters:
    """Describe what became of the exchanges, and bytes that came besides: too late, or unasked."""

    good: int = 0
    silent: int = 0
    bad: int = 0
    refused: int = 0
    late_bytes: int = 0
    unsolicited_bytes: int = 0


class Bus:
    """Exchanges requests for replies over one open port. One thread owns it, so no lock.

    Attributes:
        counters: How the exchanges went.
        echo: Whether the adapter returns our own bytes; None until a read has shown it.
        quiet_until: Until this instant a late reply could be taken for the next one, so that
            `exchange` only waits. The owner may serve its queue meanwhile.
        sent_at: When the last request went out.
        reply: What was last taken for a reply.
        stray: What was heard when bytes last came that were not requested: evidence.
    """

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        late_window_s: float,
        clock: Callable[[], float] = boot_s,
        sleep: Callable[[float], None] = sleep_exactly,
    ) -> None:
        self.counters = BusCounters()
        self.echo: bool | None = None
        self.quiet_until = 0.0
        self.sent_at = 0.0
        self.reply = b""
        self.stray = b""
        self._own_port = self._port = port
        self._timing = timing
        self._late_window_s = late_window_s
        self._clock = clock
        self._sleep = sleep
        self._quiet_s = max(_QUIET_CHARS * timing.char_s, timing.silence_s, _LEAST_QUIET_S)
        self._active_until = 0.0  # the line's last byte, ours or theirs, as far as we know
        self._late_until = 0.0  # what comes before this instant may be a late reply
        self._late_from: dict[int, float] = {}  # the same, of each station
        self._looked_at = 0.0  # when the input was last emptied
        self._tail_s = 0.0  # what follows a reply that seems to have ended
        self._habits: defaultdict[int, Habits] = defaultdict(Habits)
        self._missed_last: int | None = None  # the station that last did not answer in time
        self._settled_by = 0.0  # until then a new connection may have more to say unasked

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """Send a request and return its answer.

        Args:
            request: What to ask.
            not_after: The monotonic instant after which it must not be sent any more.
            protected: Whether its reply carries station and checksum, so that a late one cannot
                be taken for another station's.

        Raises:
            NoReplyError: Not a single byte came back in time.
            BadReplyError: What came back is not a reply to this request.
            RefusedError: The module says no.
            ExpiredError: `not_after` passed before the line was free: nothing was sent.
            PortError: The port is gone, and this bus with it.
        """
        self._settle(request.station)
        frame = request.frame
        sent_at = self._clock()
        if sent_at > not_after:
            raise ExpiredError(f"station {request.station} was not asked: it is too late")
        self.sent_at, gap_s = sent_at, sent_at - self._active_until
        deadline = sent_at + self._timing.timeout_s(len(frame), request.reply_chars)
        self._port.write(frame, deadline)
        self._active_until = sent_at + len(frame) * self._timing.char_s
        try:
            value = self._receive(request, deadline)
        except RefusedError:
            self.counters.refused += 1
            raise
        except NoReplyError:
            self.counters.silent += 1
            self._habits[request.station].missed(gap_s)
            self._let_pass(request, protected, deadline + self._late_window_s)
            raise
        except BadReplyError as error:
            self.counters.bad += 1
            garbage = error.data + self._drain()
            if self.echo is False:  # an echo that was damaged is our own bytes
                self._count_stray(len(garbage) - request.reply_chars, garbage)
            # Garbage may have come before the reply itself, which is due until the deadline.
            late_s = self._late_window_s if isinstance(error, IncompleteReplyError) else 0.0
            self._let_pass(request, protected, deadline + late_s)
            raise
        self.counters.good += 1
        self._habits[request.station].heard(gap_s)
        return value

    def await_silence(self) -> None:
        """Begin a new connection with the late window, and let what comes in it pass.

        docs/failures.md F13: some gateways say what they held back as soon as a client connects.
        """
        self.quiet_until = self._clock() + self._late_window_s
        self._settled_by = self.quiet_until + _LONGEST_SETTLING_S

    def free_at(self, station: int) -> float:
        """From when on `exchange` does not wait any more for what this station may say late.

        A late reply fits each later request of its kind, and tells what was before that. Taken for
        the reply, it leaves the true one to be taken for the next: so it has to pass first. Those
        else it cannot be taken for need not wait.
        """
        return max(self.quiet_until, self._late_from.get(station, 0.0))

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Take off the line what was not requested: while nothing is asked no one else would.

        Returns what was there, or came within `wait_s`.
        """
        stale = self._port.discard()
        if wait_s > 0:
            stale += self._port.read(_DRAIN_CHUNK, self._clock() + wait_s)
        if stale:
            stale += self._drain()
            self._count_stray(len(stale), stale)
        self._looked_at = self._clock()
        return stale

    def tap(self, hear: Hear | None) -> None:
        """Have `hear` told of every piece that passes from now on, or (None) of none any more."""
        if hear is None:
            self._port = self._own_port
        else:
            self._port = TappedPort(self._own_port, hear, lambda: self.echo is True, self._clock)

    def close(self) -> None:
        """Give the port back. May be called twice."""
        self._port.close()

    # --- before and after ---------------------------------------------------------------------

    def _settle(self, station: int) -> None:
        """Wait until the next request may go, and take off the line what is stale."""
        silent_at = self._active_until + max(self._timing.silence_s, self._tail_s)
        wait_s = max(self.free_at(station), silent_at) - self._clock()
        if wait_s > 0:
            self._sleep(wait_s)
        heard = self.listen()
        while heard and self._clock() < self._settled_by:
            heard = self.listen(self._late_window_s)
        self._settled_by = 0.0

    def _count_stray(self, count: int, heard: bytes) -> None:
        """Count bytes that are part of no reply to the last request, among those heard."""
        if count <= 0:
            return
        if not self._timing.end_silence_s and not heard[:count].strip(_LINE_FEED):
            self._tail_s = _LINE_FEED_CHARS * self._timing.char_s  # it speaks CR LF: no stranger
            return
        if self._looked_at < self._late_until:
            self.counters.late_bytes += count
            if self._missed_last is not None:
                self._habits[self._missed_last].is_late = True
            return
        self.counters.unsolicited_bytes += count
        self.stray = heard[: min(count, _EVIDENCE_BYTES)]  # what follows may be our reply

    def _let_pass(self, request: Request[Any], protected: bool, until: float) -> None:
        self._late_until = self._late_from[request.station] = until
        self._missed_last = request.station
        # docs/failures.md A8: a Wisco reply does not say whose it is, so no module is asked
        # meanwhile.
        if not protected:
            self.quiet_until = until

    def _drain(self) -> bytes:
        """Read until the line is quiet, and return what came."""
        taken = b""
        give_up = self._clock() + _LONGEST_DRAIN_S
        while self._clock() < give_up:
            data = self._read(_DRAIN_CHUNK, self._clock() + self._quiet_s)
            if not data:
                break
            taken += data
        return taken

    # --- one reply ----------------------------------------------------------------------------

    def _receive(self, request: Request[T], deadline: float) -> T:
        if self.echo is None:
            return self._receive_and_learn(request, deadline)
        if self.echo:
            echo = self._read_echo(request, deadline)
            if echo not in {b"", request.frame}:
                raise EchoDamagedError(
                    "the echo differs from what was sent: two masters or a collision", echo
                )
        reply = self._read_reply(request, b"", deadline)
        value = _decode(request, reply)
        if len(reply) > request.reply_chars:  # noise is tolerated before a reply
            self._count_stray(len(reply) - request.reply_chars, reply)
        return value

    def _receive_and_learn(self, request: Request[T], deadline: float) -> T:
        """Finish an exchange on a line of which it is not known whether it echoes."""
        frame = request.frame
        begun = self._read_echo(request, deadline)
        echoed = begun == frame
        if _mirrored(request):
            return self._believe_both(request, begun, deadline)
        if echoed:
            self.echo = True
        reply = self._read_reply(request, b"" if echoed else begun, deadline)
        value = _decode(request, reply)
        # A damaged echo in front of the reply would still be about as long as the frame.
        if not echoed and len(reply) - request.reply_chars < len(frame) // 2:
            self.echo = False
        return value

    def _believe_both(self, request: Request[T], begun: bytes, deadline: float) -> T:
        """Take a write as done only when its echo and its reply came.

        docs/failures.md A6: the two are equal, and the echo alone comes from a dead station too.
        """
        echoed = begun == request.frame
        try:
            reply = self._read_reply(request, b"" if echoed else begun, deadline)
        except NoReplyError:
            if echoed:
                raise _ambiguous(begun) from None
            raise
        value = _decode(request, reply)
        if not echoed:
            raise _ambiguous(reply)
        return value

    def _read_echo(self, request: Request[Any], deadline: float) -> bytes:
        """Read our own frame, or what comes instead of it, and nothing behind that."""
        frame = request.frame
        data = b""
        while len(data) < len(frame) and frame.startswith(data):
            due = len(frame) - len(data)
            if not self.echo:  # it may be a reply, and shorter than the frame
                due = min(due, request.missing(data) or due)
            more = self._read(due, deadline)
            if not more:
                break
            data += more
        return data

    def _read_reply(self, request: Request[Any], begun: bytes, deadline: float) -> bytes:
        """Read on until the reply can be judged. Requests bound the noise that they bear."""
        data = begun
        while due := request.missing(data):
            more = self._read(due, deadline)
            if not more:
                raise self._missed(request, data)
            data += more
        self.reply = data
        return data

    def _read(self, count: int, deadline: float) -> bytes:
        data = self._port.read(count, deadline)
        if data:
            self._active_until = self._clock()
        return data

    def _missed(self, request: Request[Any], data: bytes) -> ExchangeError:
        timeout_s = self._timing.timeout_s(len(request.frame), request.reply_chars)
        if data:
            return IncompleteReplyError(
                f"station {request.station} did not finish within {timeout_s:.2f} s", data
            )
        reading = self._habits[request.station].reading
        return NoReplyError(
            f"station {request.station} did not answer within {timeout_s:.2f} s", reading
        )


def _decode(request: Request[T], reply: bytes) -> T:
    # Nothing was missing, so None is no "not yet": it is what a good write returns.
    return cast("T", request.decode(reply))


def _mirrored(request: Request[Any]) -> bool:
    """Return whether the reply that says yes can equal the request, as for FC05 and FC06."""
    if request.missing(request.frame):
        return False
    try:
        request.decode(request.frame)
    except ExchangeError:
        return False
    return True


def _ambiguous(data: bytes) -> BadReplyError:
    return BadReplyError("an echo or the reply, and no read has told yet which", data)
