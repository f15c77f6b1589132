"""One conversation on a half-duplex line: request, reply, and the silence between them."""

import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from bridge.clock import boot_s
from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExchangeError, ExpiredError, NoReplyError, RefusedError
from bridge.model import Learned
from bridge.protocol.request import Request
from bridge.transport.habits import Habits
from bridge.transport.port import Port
from bridge.transport.tap import Hear, TappedPort
from bridge.transport.timing import LineTiming, sleep_exactly
from bridge.transport.tuning import FIXED, Tuned, Tuning

T = TypeVar("T")

# A line counts as quiet after a few characters of silence; USB adapters hold bytes for 16 ms.
_QUIET_CHARS = 5
_LEAST_QUIET_S = 0.02
# A line that never becomes quiet must not block its thread.
_LONGEST_DRAIN_S = 0.2
_DRAIN_CHUNK = 4096
# The bus waits while a gateway sends bytes that it held back, but not without a limit.
_LONGEST_SETTLING_S = 2.0
_EVIDENCE_BYTES = 16
# What a module may say behind the CR of a Wisco reply (docs/protocol.md, reading line-end).
_LINE_FEED = b"\n"
_LINE_FEED_CHARS = 3  # that, and as much again for the module to hear us


class IncompleteReplyError(BadReplyError):
    """A reply began and did not end in time. The rest of it may still come."""


class EchoDamagedError(BadReplyError):
    """Our own bytes came back, and not as they were sent."""


@dataclass(slots=True)
class BusCounters:
    """The results of the exchanges, and the number of late or unsolicited bytes."""

    good: int = 0
    silent: int = 0
    bad: int = 0
    refused: int = 0
    late_bytes: int = 0
    unsolicited_bytes: int = 0


class Bus:
    """Sends requests over one open port and reads the replies. One thread owns it, so no lock.

    Attributes:
        counters: The results of the exchanges.
        echo: Whether the adapter echoes our own bytes; None until a read has shown it.
        quiet_until: Before this instant a late reply could be taken for the next one, if that does
            not carry its station. `exchange` only waits with such a request.
        sent_at: When the last request was sent.
        reply: The bytes that were last taken as a reply.
        stray: The last unsolicited bytes, as evidence.
    """

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        late_window_s: float,
        clock: Callable[[], float] = boot_s,
        sleep: Callable[[float], None] = sleep_exactly,
        *,
        tuned: Tuned = FIXED,
    ) -> None:
        """Create it; `late_window_s` is fixed, unless it is `tuned` from then on."""
        self.counters = BusCounters()
        self.echo: bool | None = None
        self.quiet_until = 0.0
        self.sent_at = 0.0
        self.reply = b""
        self.stray = b""
        self._own_port = self._port = port
        self._timing = timing
        self._late_window_s = late_window_s  # of a new connection
        self._tuning = Tuning(timing, late_window_s, tuned)
        self._clock = clock
        self._sleep = sleep
        self._quiet_s = max(_QUIET_CHARS * timing.char_s, timing.silence_s, _LEAST_QUIET_S)
        self._active_until = 0.0  # the last byte on the line, ours or another, as far as we know
        self._late_until = 0.0  # bytes before this instant may be a late reply
        self._late_from: dict[int, float] = {}  # the same for each station
        self._looked_at = 0.0  # when the input was last emptied
        self._tail_s = 0.0  # what follows a reply that seems to have ended
        self._habits: defaultdict[int, Habits] = defaultdict(Habits)
        self._missed_last: int | None = None  # the station that last did not answer in time
        self._missed_due = 0.0  # when its reply would have ended without a turnaround
        self._settled_by = 0.0  # until then a new connection may send unsolicited bytes

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """Send a request and return its answer.

        Args:
            request: The request.
            not_after: The instant (`bridge.clock.boot_s`) after which it must not be sent.
            protected: The reply carries station and checksum, so a late one cannot be taken for
                that of another station.

        Raises:
            NoReplyError: No byte came back in time.
            BadReplyError: The bytes that came back are not a reply to this request.
            RefusedError: The module refuses.
            ExpiredError: `not_after` passed before the line was free; nothing was sent.
            PortError: The port is gone; this bus cannot be used any more.
        """
        self._settle(request.address, protected=protected)
        frame = request.frame
        sent_at = self._clock()
        if sent_at > not_after:
            raise ExpiredError(f"station {request.address} was not asked: it is too late")
        self.sent_at, gap_s = sent_at, sent_at - self._active_until
        deadline = sent_at + self._timeout_s(request)
        self._port.write(frame, deadline)
        self._active_until = sent_at + len(frame) * self._timing.char_s
        try:
            value = self._receive(request, deadline)
        except RefusedError:
            self.counters.refused += 1
            raise
        except NoReplyError:
            self.counters.silent += 1
            self._missed_one(request.address, gap_s)
            late_s = self._tuning.late_window_s(request.address)
            self._let_pass(request, protected, deadline + late_s)
            raise
        except BadReplyError as error:
            self.counters.bad += 1
            garbage = error.data + self._drain()
            if self.echo is False:  # a damaged echo consists of our own bytes
                self._count_stray(len(garbage) - request.reply_chars, garbage)
            # Noise may come before the reply, which is due until the deadline.
            incomplete = isinstance(error, IncompleteReplyError)
            late_s = self._tuning.late_window_s(request.address) if incomplete else 0.0
            self._let_pass(request, protected, deadline + late_s)
            raise
        self.counters.good += 1
        self._habits[request.address].heard(gap_s)
        self._began(request.address, self._active_until, sent_at + self._at_once_s(request))
        return value

    def await_silence(self) -> None:
        """Keep the late window on a new connection, and drop what comes in it.

        Some gateways send what they held back as soon as a client connects (docs/failures.md F13).
        """
        self.quiet_until = self._clock() + self._late_window_s
        self._settled_by = self.quiet_until + _LONGEST_SETTLING_S

    def free_at(self, address: int, *, protected: bool = False) -> float:
        """Return from when on `exchange` need not wait for a late reply.

        A late reply fits every later request of the same kind and reports an old state. If it were
        taken as the reply, the true reply would be taken for that to the next request. So a request
        that such a reply fits waits until it must have come. Other requests need not wait: those to
        other stations whose replies carry the station.
        """
        own = self._late_from.get(address, 0.0)
        if protected and not self._settled_by:
            return own
        return max(self.quiet_until, own)

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Take unsolicited bytes off the line, which otherwise happens only before a request.

        Return what was there, or came within `wait_s`.
        """
        strays = self._port.discard()
        if wait_s > 0:
            strays += self._port.read(_DRAIN_CHUNK, self._clock() + wait_s)
        if strays:
            strays += self._drain()
            self._count_stray(len(strays), strays)
        self._looked_at = self._clock()
        return strays

    def tap(self, hear: Hear | None) -> None:
        """Call `hear(at, data, sent)` for each chunk that passes; None stops it."""
        if hear is None:
            self._port = self._own_port
        else:
            self._port = TappedPort(self._own_port, hear, lambda: self.echo is True, self._clock)

    def forget(self, address: int) -> None:
        """Forget what was learned of a station: it was offline."""
        self._tuning.forget(address)

    def learned(self, address: int) -> Learned:
        """Return the times of a station that are learned."""
        return self._tuning.learned(address)

    def close(self) -> None:
        """Close the port. May be called twice."""
        self._port.close()

    # --- before and after ---------------------------------------------------------------------

    def _settle(self, address: int, *, protected: bool) -> None:
        """Wait until the next request may be sent, and take stray bytes off the line."""
        silent_at = self._active_until + max(self._tuning.silence_s(address), self._tail_s)
        free_at = self.free_at(address, protected=protected)
        wait_s = max(free_at, silent_at) - self._clock()
        if wait_s > 0:
            self._wait(self._clock() + wait_s)
        heard = self.listen()
        while heard and self._clock() < self._settled_by:
            heard = self.listen(self._late_window_s)
        self._settled_by = 0.0

    def _wait(self, until: float) -> None:
        """Wait; note when a late reply comes meanwhile, if that is learned."""
        if self._tuning.learns_lateness and self._clock() < self._late_until:
            heard = self._port.read(1, min(until, self._late_until))
            if heard:
                heard += self._drain()
                self._count_stray(len(heard), heard)
                self._looked_at = self._clock()
        left_s = until - self._clock()
        if left_s > 0:
            self._sleep(left_s)

    def _count_stray(self, count: int, heard: bytes) -> None:
        """Count bytes that are not part of a reply to the last request."""
        if count <= 0:
            return
        if not self._timing.end_silence_s and not heard[:count].strip(_LINE_FEED):
            self._tail_s = _LINE_FEED_CHARS * self._timing.char_s  # it speaks CR LF: no stranger
            return
        if self._looked_at < self._late_until:
            self.counters.late_bytes += count
            if self._missed_last is not None:
                self._habits[self._missed_last].is_late = True
                came_at = min(self._clock(), self._late_until)
                self._began(self._missed_last, came_at, self._missed_due)
            return
        self.counters.unsolicited_bytes += count
        self.stray = heard[: min(count, _EVIDENCE_BYTES)]  # what follows may be our reply

    def _let_pass(self, request: Request[Any], protected: bool, until: float) -> None:
        self._late_from[request.address] = until
        self._late_until = max(self._late_until, until)
        self._missed_last = request.address
        self._missed_due = self.sent_at + self._at_once_s(request)
        # docs/failures.md A8: a Wisco reply does not carry its station, so in this time no module
        # is asked in such frames.
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

    # --- what is learned ----------------------------------------------------------------------

    def _timeout_s(self, request: Request[Any]) -> float:
        turnaround_s = self._tuning.turnaround_s(request.address)
        return self._timing.timeout_s(len(request.frame), request.reply_chars, turnaround_s)

    def _at_once_s(self, request: Request[Any]) -> float:
        """Return the time of an exchange with a module that needs no time to answer."""
        chars = len(request.frame) + request.reply_chars
        return chars * self._timing.char_s + self._timing.end_silence_s

    def _began(self, address: int, ended_at: float, due_at: float) -> None:
        if self._tuning.learns_lateness:
            self._tuning.replied(address, ended_at - due_at)

    def _missed_one(self, address: int, gap_s: float) -> None:
        habits = self._habits[address]
        habits.missed(gap_s)
        if habits.reading == "silence-before" and self._tuning.wants_silence(address):
            self._habits[address] = Habits()

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
        if len(reply) > request.reply_chars:  # a reply may have noise before it
            self._count_stray(len(reply) - request.reply_chars, reply)
        return value

    def _receive_and_learn(self, request: Request[T], deadline: float) -> T:
        """Finish an exchange while it is not known whether the adapter echoes."""
        frame = request.frame
        begun = self._read_echo(request, deadline)
        echoed = begun == frame
        if _mirrored(request):
            return self._believe_both(request, begun, deadline)
        if echoed:
            self.echo = True
        reply = self._read_reply(request, b"" if echoed else begun, deadline)
        value = _decode(request, reply)
        # Together with the reply, a damaged echo would be about as long as the frame.
        if not echoed and len(reply) - request.reply_chars < len(frame) // 2:
            self.echo = False
        return value

    def _believe_both(self, request: Request[T], begun: bytes, deadline: float) -> T:
        """Return the result of a write only after both its echo and its reply came.

        The two are equal, and the echo alone also comes when the station is dead (docs/failures.md
        A6).
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
        """Return our own frame, or what comes in its place, and no byte more."""
        frame = request.frame
        data = b""
        while len(data) < len(frame) and frame.startswith(data):
            due = len(frame) - len(data)
            if not self.echo:  # it may be a reply that is shorter than the frame
                due = min(due, request.missing(data) or due)
            more = self._read(due, deadline)
            if not more:
                break
            data += more
        return data

    def _read_reply(self, request: Request[Any], begun: bytes, deadline: float) -> bytes:
        """Read until the reply can be judged. The request limits the noise that it tolerates."""
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
        timeout_s = self._timeout_s(request)
        if data:
            return IncompleteReplyError(
                f"station {request.address} did not finish within {timeout_s:.2f} s", data
            )
        reading = self._habits[request.address].reading
        return NoReplyError(
            f"station {request.address} did not answer within {timeout_s:.2f} s", reading
        )


def bus_of(
    line: LineConfig,
    port: Port,
    clock: Callable[[], float] = boot_s,
    sleep: Callable[[float], None] = sleep_exactly,
) -> Bus:
    """Return a bus with the times of a configured line."""
    timing = LineTiming.from_config(line)
    return Bus(port, timing, line.late_window_s, clock, sleep, tuned=Tuned.of(line))


def _decode(request: Request[T], reply: bytes) -> T:
    # No byte was missing, so None does not mean "not yet": it is the value of a good write.
    return cast("T", request.decode(reply))


def _mirrored(request: Request[Any]) -> bool:
    """Return whether the good reply can equal the request, as with FC05 and FC06."""
    if request.missing(request.frame):
        return False
    try:
        request.decode(request.frame)
    except ExchangeError:
        return False
    return True


def _ambiguous(data: bytes) -> BadReplyError:
    return BadReplyError("an echo or the reply, and no read has told yet which", data)
