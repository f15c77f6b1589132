import time

from bridge.clock import SuspendWatch, boot_s


def test_the_clock_counts_a_suspend() -> None:
    """`boot_s` is the Linux clock that counts during a suspend."""
    before = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert before <= boot_s() <= time.clock_gettime(time.CLOCK_BOOTTIME)


def test_a_suspend_is_told_once_with_its_length() -> None:
    """The two clocks drift apart by 15 s: that long the machine was suspended."""
    watch = SuspendWatch(boot=1000.0, awake=400.0)
    assert watch.slept_s(boot=1001.0, awake=401.0) == 0.0
    assert watch.slept_s(boot=1017.0, awake=402.0) == 15.0
    assert watch.slept_s(boot=1018.0, awake=403.0) == 0.0


def test_clocks_that_were_not_read_in_one_instant_are_no_suspend() -> None:
    """The thread may be interrupted between the two looks."""
    watch = SuspendWatch(boot=1000.0, awake=400.0)
    assert watch.slept_s(boot=1000.4, awake=400.0) == 0.0
