"""Decides when a port is opened again, and when its changes are published.

A gateway that drops its connection is opened again before anything is published. One that comes and
goes has to hold longer each time before it counts as online. Time is an argument
(`bridge.clock.boot_s`).
"""

import math

REOPEN_FIRST_S = 0.25
REOPEN_LAST_S = 2.0
HELD_S = 2.0  # a connection that held this long is opened again at once after a loss
# Promise 8: offline within 5 s. This leaves the following time for a return before it is published.
GRACE_S = 3.0
# After less than this time online the port is flapping: it is on trial when it comes back.
STEADY_S = 5.0
STEADY_GATEWAY_S = 60.0
TRIAL_FIRST_S = 2.0
TRIAL_LAST_S = 30.0
RENEW_FIRST_S = 5.0
RENEW_LAST_S = 300.0
REMIND_S = 600.0


class PortLife:
    """The life of one port. A gateway is a port on the network.

    Attributes:
        online: The published state of the line; None: nothing yet.
        is_used: An exchange was made since the port was opened, answered or not.
        open_at: When to open it, while it is closed.
    """

    def __init__(self, *, gateway: bool) -> None:
        self.online: bool | None = None
        self.is_used = False
        self.open_at = 0.0
        self._gateway = gateway
        self._opened_at = math.inf  # infinite: it is closed
        self._pause_s = REOPEN_FIRST_S
        self._down_at = math.inf  # when the loss of the port is published
        self._up_at = -math.inf  # when its presence was last published
        self._lost_at = -math.inf
        self._trial_s = 0.0  # how long it has to hold before this is published
        self._renew_at = math.inf
        self._renew_s = RENEW_FIRST_S
        self._drops_told_at = -math.inf
        self._silence_told_at = -math.inf

    # --- what happens -------------------------------------------------------------------------

    def opened(self, now: float) -> None:
        """Record that the port is open."""
        self._opened_at = now
        self.is_used = False
        if self._renew_at is math.inf or now >= self._renew_at:
            self._renew_at = now + self._renew_s
            self._renew_s = min(2 * self._renew_s, RENEW_LAST_S)

    def lost(self, now: float) -> None:
        """Record that the port is gone, or could not be opened."""
        was_open = self._opened_at <= now
        # A device that hangs up was unplugged; a gateway may only have dropped the connection.
        grace_s = GRACE_S if self._gateway and self.online else 0.0
        if not self.is_missed:
            self._lost_at = now
        self._down_at = min(self._down_at, now + grace_s)
        if was_open and now - self._opened_at >= HELD_S:
            self._pause_s = REOPEN_FIRST_S
        self._close(now + self._pause_s)
        self._pause_s = min(2 * self._pause_s, REOPEN_LAST_S)

    def recovered(self) -> None:
        """Record that everything is as it was before the loss."""
        self._down_at = math.inf

    def rest(self, until: float) -> None:
        """Record that the gateway closed an unused connection: it is opened when it is needed."""
        self._close(until)

    def heard(self, now: float) -> None:
        """Record that a module is online: if all become silent, the connection may be deaf."""
        self._renew_at = now
        self._renew_s = RENEW_FIRST_S

    def told(self, now: float, *, online: bool) -> None:
        """Record that the state of the line was published."""
        if online:
            self._up_at = now
        elif self.online:
            self._judge(self._lost_at - self._up_at)
        self.online = online

    # --- what follows -------------------------------------------------------------------------

    @property
    def is_missed(self) -> bool:
        """Return whether it was lost, which is published unless it recovers."""
        return self._down_at < math.inf

    def is_down_due(self, now: float) -> bool:
        """Return, once, whether the time is over in which a lost port may recover."""
        due = now >= self._down_at
        if due:
            self._down_at = math.inf
        return due

    def is_up_due(self, now: float) -> bool:
        """Return whether to publish that the line is online."""
        return not self.online and self.is_used and now - self._opened_at >= self._trial_s

    @property
    def is_drop(self) -> bool:
        """Return whether a loss now may be repaired before it is published."""
        return self._gateway and self.is_used and self.online is True

    def is_idle_close(self, now: float, *, anybody: bool) -> bool:
        """Return whether the loss of a connection is no error, because no module was online."""
        held = now - self._opened_at >= HELD_S
        return self._gateway and self.online is True and held and not anybody

    def is_deaf(self, now: float) -> bool:
        """Return whether to open a new connection, while no module is online."""
        return self._gateway and now >= self._renew_at

    def may_tell_drop(self, now: float) -> bool:
        """Return whether to log a drop that is repaired at once."""
        due = now - self._drops_told_at >= REMIND_S
        if due:
            self._drops_told_at = now
        return due

    def may_tell_silence(self, now: float) -> bool:
        """Return whether to log that no module answers."""
        first = self._renew_s <= RENEW_FIRST_S or self._renew_s == 2 * RENEW_FIRST_S
        due = first and now - self._silence_told_at >= REMIND_S
        if due:
            self._silence_told_at = now
        return due

    def _judge(self, held_s: float) -> None:
        """Set how long the port has to hold next time: a short life needs a longer trial."""
        longest_s = TRIAL_LAST_S if self._gateway else TRIAL_FIRST_S
        if held_s >= (STEADY_GATEWAY_S if self._gateway else STEADY_S):
            self._trial_s = 0.0
        else:
            self._trial_s = min(max(2 * self._trial_s, TRIAL_FIRST_S), longest_s)

    def _close(self, open_at: float) -> None:
        self._opened_at = math.inf
        self.is_used = False
        self.open_at = open_at
