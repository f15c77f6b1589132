"""Sends the frames of one write, each once, and reads the outputs after the last."""

import math
from collections.abc import Callable, Iterable
from contextlib import suppress

from bridge.errors import ExchangeError, ExpiredError, PortError, RefusedError
from bridge.line.exchanger import Exchanger
from bridge.line.rules.frames import frames_for, gaps_in
from bridge.line.station import Station

# The write and these reads take less than 2 s if no module answers, so other modules wait no
# longer.
READ_TRIES = 3
_OFF_TRIES = 2


class Sending:
    """Describe what goes out for one write. Used by the thread of the line.

    Attributes:
        started: The outputs that were switched ON, as far as we know.
        sent: Whether a frame went out.
        unsent: The outputs of the write that no frame named yet.
        unanswered: The outputs whose last frame was not acknowledged.
    """

    def __init__(
        self,
        station: Station,
        bus: Exchanger,
        mask: int,
        clock: Callable[[], float],
    ) -> None:
        self.started = 0
        self.sent = False
        self.unsent = mask
        self.unanswered = 0
        self._station = station
        self._bus = bus
        self._clock = clock

    def send(self, frames: Iterable[int], values: int, current: int, not_after: float) -> None:
        """Send each frame once, and none behind one that was not answered or is too late.

        Args:
            frames: The outputs of each.
            values: What the outputs are set to.
            current: What was just read: a Modbus range writes the gaps back as they are.
            not_after: The deadline.

        Raises:
            ExpiredError: Nothing was sent: the deadline passed before the line was free.
            RefusedError: The module refuses.
            PortError: The port is gone.
        """
        begun = False
        for frame in frames:
            try:
                self._send_one(frame, values & frame, current, not_after)
            except ExpiredError:
                if not begun:
                    raise
                return
            begun = True
            if self.unanswered & frame:
                return

    def look(self) -> int | None:
        """Return the outputs after the write: this read is the state, not the acknowledgement."""
        seen = self._station.read_outputs(self._bus, READ_TRIES)
        if seen is not None:
            self._station.outputs.value = seen
            self._station.interlock.observe(seen, self._clock())
            self._station.found(seen, self._clock())
        return seen

    def switch_off(self, outputs: int) -> None:
        """Switch OFF what this write switched ON and would stay ON; no deadline applies."""
        left = outputs
        for _ in range(_OFF_TRIES):
            for frame in frames_for(left, 0, spared=gaps_in(left)):
                with suppress(RefusedError):  # the following read shows the result
                    self._send_one(frame, 0, 0, math.inf)
            seen = self.look()
            left &= left if seen is None else seen
            if not left:
                return

    def _send_one(self, mask: int, values: int, current: int, not_after: float) -> None:
        writer = self._station.writer
        request = writer.write_outputs(mask, values, current)
        try:
            self._bus.exchange(request, protected=writer.protected, not_after=not_after)
        except ExpiredError:
            raise
        except (RefusedError, PortError):
            self._went_out(mask, values)
            raise
        except ExchangeError:
            self._went_out(mask, values)
            self.unanswered |= mask
        else:
            self._went_out(mask, values)

    def _went_out(self, mask: int, values: int) -> None:
        self.sent = True
        self.started |= values
        self.unsent &= ~mask
        self.unanswered &= ~mask
        self._station.ordered(mask, values, self._bus.sent_at)
