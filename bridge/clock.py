"""The clock of the daemon: seconds since boot, with the time in which the machine was suspended.

`time.monotonic` stands still while the machine is suspended. A command that waits meanwhile would
look young when it wakes up (docs/failures.md F7). The clock on the wall is set by people and by
the network, so it judges nothing (E4).
"""

import time


def boot_s() -> float:
    """Return seconds since boot; they go on while the machine is suspended, and are never set."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class SuspendWatch:
    """Tells for how long the machine was suspended. Only the main thread uses it."""

    def __init__(self, boot: float, awake: float) -> None:
        self._suspended_s = boot - awake

    def slept_s(self, boot: float, awake: float) -> float:
        """Return for how long it was suspended since the last call: 0 if it was not.

        Args:
            boot: What `boot_s` shows now.
            awake: What a clock shows now that stands still meanwhile (`time.monotonic`).
        """
        before, self._suspended_s = self._suspended_s, boot - awake
        slept_s = self._suspended_s - before
        return slept_s if slept_s > _LEAST_S else 0.0


_LEAST_S = 0.5  # the two are not read in one instant
