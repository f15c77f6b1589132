"""The clock of the daemon: seconds since boot, including the time of a suspend.

`time.monotonic` stands still while the machine is suspended, so a command that waited during a
suspend would look young (docs/failures.md F7). The wall clock can be set by people and by the
network, so no decision uses it (E4).
"""

import time


def boot_s() -> float:
    """Return the seconds since boot; they count during a suspend, and are never set."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class SuspendWatch:
    """Measures how long the machine was suspended. Only the main thread uses it."""

    def __init__(self, boot: float, awake: float) -> None:
        self._suspended_s = boot - awake

    def slept_s(self, boot: float, awake: float) -> float:
        """Return how long the machine was suspended since the last call; 0 if it was not.

        Args:
            boot: The present value of `boot_s`.
            awake: The present value of a clock that stands still during a suspend
                (`time.monotonic`).
        """
        before, self._suspended_s = self._suspended_s, boot - awake
        slept_s = self._suspended_s - before
        return slept_s if slept_s > _LEAST_S else 0.0


_LEAST_S = 0.5  # the two clocks are not read at the same instant
