"""What SIGINT and SIGTERM do to a command at work."""

import signal

import pytest

from bridge.cli.frame.interrupt import interrupts_kept, sigterm_interrupts

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


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


def test_after_the_block_signals_interrupt_as_before() -> None:
    """After a block that kept them, SIGTERM and SIGINT raise KeyboardInterrupt again."""
    with sigterm_interrupts():
        with interrupts_kept():
            pass
        for number in (signal.SIGINT, signal.SIGTERM):
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
