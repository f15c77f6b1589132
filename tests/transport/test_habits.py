"""Why a module that is there does not answer."""

from bridge.transport.habits import Habits


def test_replies_after_the_time_out_name_the_turnaround() -> None:
    """Until a good reply comes."""
    habits = Habits()
    habits.is_late = True
    assert habits.reading == "turnaround"
    habits.heard(1.0)
    assert habits.reading is None


def test_a_module_that_hears_only_after_silence_is_noticed() -> None:
    """It misses what follows closely, and answers what does not."""
    habits = Habits()
    for _ in range(4):
        habits.heard(0.4)
        habits.missed(0.0)
    assert habits.reading == "silence-before"
    habits.heard(0.0)
    assert habits.reading is None


def test_a_module_that_is_absent_is_not_explained() -> None:
    """It answers nothing, whatever the silence."""
    habits = Habits()
    for gap_s in (0.0, 0.4) * 10:
        habits.missed(gap_s)
    assert habits.reading is None
