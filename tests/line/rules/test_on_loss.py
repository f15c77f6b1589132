import pytest

from bridge.line.rules.on_loss import OnLoss

AFTER_S = 30.0


@pytest.mark.parametrize("on", [True, False])
def test_it_is_due_when_the_broker_was_away_for_that_long(on: bool) -> None:
    """The order is due after the time of the loss, whatever the output is."""
    rule = OnLoss(1, AFTER_S, on=on)
    rule.seen(on, 100.0)
    assert not rule.is_due(1e6)
    rule.broker(100.0)
    assert not rule.is_due(129.9)
    assert rule.is_due(130.0)
    assert rule.on is on


def test_a_broker_that_is_back_in_time_changes_nothing() -> None:
    """The next loss has its whole time."""
    rule = OnLoss(1, AFTER_S, on=False)
    rule.broker(100.0)
    rule.broker(None)
    assert not rule.is_due(1e6)
    rule.broker(120.0)
    assert not rule.is_due(149.9)
    assert rule.is_due(150.0)


def test_it_is_done_once_a_loss() -> None:
    """The order is made once in a loss, however long it lasts, and again in the next one."""
    rule = OnLoss(1, AFTER_S, on=False)
    rule.broker(100.0)
    rule.tried(over=True, now=130.0)
    assert not rule.is_due(1e6)
    rule.broker(None)
    rule.broker(2e6)
    assert rule.is_due(2e6 + AFTER_S)


def test_what_failed_is_due_again_while_the_loss_lasts() -> None:
    """After a pause; a broker that is back ends that too."""
    rule = OnLoss(1, AFTER_S, on=False)
    rule.broker(100.0)
    rule.tried(over=False, now=130.0)
    assert not rule.is_due(130.9)
    assert rule.is_due(131.0)
    assert rule.failing
    rule.broker(None)
    assert not rule.failing
    assert not rule.is_due(200.0)
