"""What SIGINT and SIGTERM do to a command at work."""

import signal
from collections.abc import Iterator

import pytest

from bridge.cli.frame.interrupt import interrupts_kept, sigterm_interrupts

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


@pytest.fixture(autouse=True)
def _both_are_heard() -> Iterator[None]:
    """Have SIGINT raise KeyboardInterrupt, and SIGTERM too, whatever the test runner has set."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with sigterm_interrupts():
        yield
    signal.signal(signal.SIGINT, before)


@BOTH
def test_a_kept_interrupt_does_not_break_into_the_block(number: signal.Signals) -> None:
    """One signal in the block: the next statement still runs, and the block can ask for it."""
    done = []
    with interrupts_kept() as stopped:
        assert not stopped()
        signal.raise_signal(number)
        done.append("the statement after it")
        assert stopped()
    assert done


@BOTH
def test_a_second_interrupt_ends_a_block_that_hangs(number: signal.Signals) -> None:
    """Two signals in the block: the second raises KeyboardInterrupt."""
    with interrupts_kept():
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)


@BOTH
def test_after_the_block_signals_interrupt_as_before(number: signal.Signals) -> None:
    """After a block that kept them, SIGTERM and SIGINT raise KeyboardInterrupt again."""
    with interrupts_kept():
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def test_a_signal_that_is_ignored_stays_so() -> None:
    """In the background of a script SIGINT is ignored: it ends no block."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_kept() as stopped:
        signal.raise_signal(signal.SIGINT)
        assert not stopped()
