import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.config.schema import GestureConfig, InputConfig
from bridge.line.rules.gestures import Buttons, buttons_among
from bridge.model import Gesture

LONG_S, DOUBLE_S = 0.8, 0.4
STEP_S = 0.05  # between two reads
FULL = GestureConfig(LONG_S, DOUBLE_S)
QUICK = GestureConfig(LONG_S, double_s=0.0)

Made = list[tuple[float, Gesture]]


def buttons(*configs: GestureConfig | None) -> Buttons:
    """A module whose inputs 1, 2 ... are these buttons."""
    found = buttons_among(InputConfig(n, gestures=c) for n, c in enumerate(configs, start=1))
    assert found is not None
    return found


def press(pattern: str, config: GestureConfig = FULL) -> Made:
    """Reads one button every 50 ms, pressed at each `#`; gives what was told, and when."""
    button = buttons(config)
    made: Made = []
    for n, sign in enumerate(pattern):
        made += [(n * STEP_S, g) for _, g in button.observe(int(sign == "#"), n * STEP_S)]
    return made


def only(pattern: str, config: GestureConfig = FULL) -> list[Gesture]:
    """The same without the instants."""
    return [gesture for _, gesture in press(pattern, config)]


@pytest.mark.parametrize(
    ("pattern", "gestures"),
    [
        ("....", []),
        (".##" + 10 * ".", [Gesture.SHORT]),
        (".#" + 10 * ".", [Gesture.SHORT]),
        ("." + 15 * "#" + 10 * ".", [Gesture.SHORT]),
        ("." + 20 * "#" + 10 * ".", [Gesture.LONG]),
        ("." + 100 * "#", [Gesture.LONG]),
        (".##...##" + 20 * ".", [Gesture.DOUBLE]),
        (".##...##..##..##" + 20 * ".", [Gesture.DOUBLE, Gesture.DOUBLE]),
        (".##...##..##" + 20 * ".", [Gesture.DOUBLE, Gesture.SHORT]),
        (".##..." + 40 * "#" + 20 * ".", [Gesture.DOUBLE]),
        (".##" + 9 * "." + "##" + 20 * ".", [Gesture.SHORT, Gesture.SHORT]),
        ("." + 20 * "#" + "..##" + 20 * ".", [Gesture.LONG, Gesture.SHORT]),
    ],
)
def test_presses_make_gestures(pattern: str, gestures: list[Gesture]) -> None:
    """Let go in time, held, or pressed again in time; every press is told once."""
    assert only(pattern) == gestures


def test_a_long_press_is_told_while_it_lasts() -> None:
    """A long press is reported while the button is still held."""
    [(at, gesture)] = press("." + 100 * "#")
    assert gesture is Gesture.LONG
    assert at == pytest.approx(STEP_S + LONG_S)


def test_a_short_press_is_told_when_no_second_one_can_follow() -> None:
    """A short press is reported by the first read after a second one is impossible."""
    [(at, gesture)] = press(".##" + 40 * ".")
    assert gesture is Gesture.SHORT
    assert at == pytest.approx(3 * STEP_S + DOUBLE_S)


def test_without_double_presses_a_short_one_is_told_at_once() -> None:
    """`double: 0s`: there is nothing to wait for when it is let go."""
    [(first_at, _), (second_at, _)] = made = press(".##...##...", QUICK)
    assert {gesture for _, gesture in made} == {Gesture.SHORT}
    assert (first_at, second_at) == pytest.approx((3 * STEP_S, 8 * STEP_S))


def test_a_double_press_is_told_at_its_second_press() -> None:
    """A double press is reported at its second press."""
    [(at, gesture)] = press(".##...##....")
    assert gesture is Gesture.DOUBLE
    assert at == pytest.approx(6 * STEP_S)


def test_what_was_pressed_at_the_first_read_is_no_gesture() -> None:
    """A button that is ON at the first read gives no gesture; after its release it works."""
    assert only(40 * "#" + "..##" + 20 * ".") == [Gesture.SHORT]


@pytest.mark.parametrize("before", ["##", "##..", 40 * "#", "##...##"])
def test_what_was_going_on_when_the_module_went_is_dropped(before: str) -> None:
    """Pressed, waiting for a second press, or told: afterwards nothing is made of it."""
    button = buttons(FULL)
    button.observe(0, 0.0)
    told: list[tuple[int, Gesture]] = []
    for n, sign in enumerate(before):
        told = button.observe(int(sign == "#"), n * STEP_S)
    button.forget()
    now = 60.0
    for value in (0, 1):
        for _ in range(3):
            told = button.observe(value, now)
            assert told == []
            now += STEP_S


@pytest.mark.parametrize("value", [0, 1])
def test_a_press_over_a_gap_between_reads_is_dropped(value: int) -> None:
    """Unread for longer than a long press lasts, it may have been anything."""
    button = buttons(FULL)
    assert button.observe(0, 0.0) == []
    assert button.observe(1, 0.1) == []
    assert button.observe(value, 0.1 + LONG_S + 0.01) == []
    assert button.observe(0, 1.0) == []
    assert button.observe(0, 1.0 + DOUBLE_S) == []


def test_a_button_at_rest_minds_no_gap() -> None:
    """A press that begins after it is seen from its beginning."""
    button = buttons(QUICK)
    for now in (0.0, 30.0, 30.1):
        assert button.observe(0, now) == []
    assert button.observe(1, 30.2) == []
    assert button.observe(0, 30.3) == [(1, Gesture.SHORT)]


def test_each_input_has_its_own_times() -> None:
    """Two buttons pressed together make what each is told by its own configuration."""
    two = buttons(QUICK, None, GestureConfig(long_s=0.2, double_s=0.0))
    assert two.observe(0, 0.0) == []
    assert two.observe(0b111, 0.1) == []
    assert two.observe(0b111, 0.2) == []
    assert two.observe(0b111, 0.35) == [(3, Gesture.LONG)]
    assert two.observe(0, 0.4) == [(1, Gesture.SHORT)]


def test_a_module_without_buttons_has_none() -> None:
    """A module without buttons has no gestures, and its polls need no work for them."""
    assert buttons_among([InputConfig(1), InputConfig(2)]) is None


@given(st.lists(st.tuples(st.booleans(), st.floats(0.01, 2.0)), max_size=80))
def test_no_more_gestures_than_presses(reads: list[tuple[bool, float]]) -> None:
    """Each press is reported at most once, and none without a press, for any reads."""
    button = buttons(FULL)
    now, before, presses, made = 0.0, False, 0, 0
    button.observe(0, now)
    for on, pause_s in reads:
        now += pause_s
        presses += on and not before
        before = on
        made += len(button.observe(int(on), now))
        assert made <= presses
