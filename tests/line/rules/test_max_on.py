from bridge.line.rules.max_on import MaxOn
from bridge.line.rules.retry import LONGEST_PAUSE_S

LIMIT_S = 600.0


def test_it_is_due_when_it_was_seen_on_for_that_long() -> None:
    """Counted from the first look that found it ON; further looks change nothing."""
    rule = MaxOn(3, LIMIT_S)
    assert not rule.is_due(1e6)
    rule.seen(True, 100.0)
    rule.seen(True, 500.0)
    assert not rule.is_due(699.9)
    assert rule.is_due(700.0)


def test_off_in_between_starts_it_anew() -> None:
    """After an OFF in between the next ON has its whole time."""
    rule = MaxOn(3, LIMIT_S)
    rule.seen(True, 100.0)
    rule.seen(False, 600.0)
    assert not rule.is_due(1e6)
    rule.seen(True, 650.0)
    assert not rule.is_due(1249.9)
    assert rule.is_due(1250.0)


def test_once_done_it_is_not_due_again() -> None:
    """Until it is seen ON again."""
    rule = MaxOn(3, LIMIT_S)
    rule.seen(True, 100.0)
    rule.tried(over=True, now=700.0)
    assert not rule.is_due(1e6)


def test_what_failed_is_due_again_after_pauses_that_grow() -> None:
    """1, 2, 4 ... 30 s, for as long as it is ON; a success ends it, and the next one is fresh."""
    rule = MaxOn(3, LIMIT_S)
    rule.seen(True, 100.0)
    now, pauses = 700.0, []
    for _ in range(8):
        rule.tried(over=False, now=now)
        assert rule.failing
        began = now
        while not rule.is_due(now):
            now += 0.5
        pauses.append(now - began)
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, *[LONGEST_PAUSE_S] * 3]
    rule.seen(False, now)
    assert not rule.failing
