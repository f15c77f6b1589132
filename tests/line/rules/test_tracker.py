from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from bridge.line.rules.tracker import BankTracker, Outcome

READS = st.lists(st.integers(0, 7), max_size=60)


def publish_all(bank: BankTracker, reads: list[int], step_s: float = 0.1) -> list[int]:
    """Feeds reads 0.1 s apart; returns every value that was to be published."""
    published: list[int] = []
    for n, raw in enumerate(reads):
        if bank.observe(raw, n * step_s) is Outcome.CHANGED:
            assert bank.value is not None
            published.append(bank.value)
    return published


@given(READS)
def test_over_unprotected_frames_nothing_is_published_that_was_not_read_twice_in_a_row(
    reads: list[int],
) -> None:
    """An unprotected change or first value is published after two equal reads (promise 5)."""
    bank = BankTracker(confirm=True)
    twice = {one for one, other in pairwise(reads) if one == other}
    assert set(publish_all(bank, reads)) <= twice


@given(READS)
def test_over_unprotected_frames_what_is_read_twice_in_a_row_is_the_value(
    reads: list[int],
) -> None:
    """A true change is published at its second read, at the latest."""
    bank = BankTracker(confirm=True)
    before: int | None = None
    for raw in reads:
        bank.observe(raw, 0.0)
        if raw == before:
            assert bank.value == raw
        before = raw


@given(READS)
def test_over_protected_frames_every_read_is_the_value(reads: list[int]) -> None:
    """CRC or LRC and station let a single reply be believed; only changes are published."""
    bank = BankTracker(confirm=False)
    published = publish_all(bank, reads)
    expected = [raw for n, raw in enumerate(reads) if n == 0 or raw != reads[n - 1]]
    assert published == expected


def test_an_unconfirmed_change_asks_to_be_read_again() -> None:
    """The first sight of a change publishes nothing, and asks for a second read."""
    bank = BankTracker(confirm=True)
    assert bank.observe(5, 0.0) is Outcome.READ_AGAIN
    assert bank.value is None
    assert bank.observe(5, 0.1) is Outcome.CHANGED
    assert bank.observe(5, 0.2) is Outcome.UNCHANGED
    assert bank.observe(4, 0.3) is Outcome.READ_AGAIN
    assert bank.value == 5


def test_a_read_from_before_a_write_confirms_nothing() -> None:
    """After the module was written a change is read twice anew (docs/failures.md C2)."""
    bank = BankTracker(confirm=True)
    publish_all(bank, [1, 1])
    bank.observe(0, 1.0)
    bank.drop_candidate()
    assert bank.observe(0, 1.1) is Outcome.READ_AGAIN
    assert bank.value == 1


def test_inverted_inputs_are_published_inverted() -> None:
    """A normally closed contact reads ON when it is open."""
    bank = BankTracker(confirm=False, invert=0b101)
    bank.observe(0b001, 0.0)
    assert bank.value == 0b100


def test_a_first_value_is_published_without_waiting_for_its_debounce_time() -> None:
    """A first value is published without a debounce time, as there is no old value."""
    bank = BankTracker(confirm=False, debounce_s={1: 9.0})
    assert bank.observe(1, 0.0) is Outcome.CHANGED


def test_a_bouncing_contact_is_published_once_it_is_steady() -> None:
    """A bouncing contact is published once it was steady for the whole debounce time."""
    bank = BankTracker(confirm=False, debounce_s={1: 0.25})
    assert publish_all(bank, [0, 1, 0, 1, 1, 1]) == [0]
    assert bank.observe(1, 0.61) is Outcome.CHANGED
    assert bank.value == 1


def test_a_debounce_time_holds_back_its_own_channel_alone() -> None:
    """Another channel's change goes out at once, and the held one follows."""
    bank = BankTracker(confirm=False, debounce_s={1: 0.25})
    assert publish_all(bank, [0, 0b11]) == [0, 0b10]
    assert bank.observe(0b11, 0.2) is Outcome.UNCHANGED
    assert bank.observe(0b11, 0.4) is Outcome.CHANGED
    assert bank.value == 0b11


def test_a_held_channel_that_went_back_starts_anew_even_while_another_changes() -> None:
    """A channel that went back starts its debounce time again, also if another changes."""
    bank = BankTracker(confirm=False, debounce_s={1: 0.25})
    publish_all(bank, [0, 0b01, 0b10])
    assert bank.value == 0b10
    assert bank.observe(0b11, 0.4) is Outcome.UNCHANGED
    assert bank.observe(0b11, 0.6) is Outcome.UNCHANGED
    assert bank.observe(0b11, 0.65) is Outcome.CHANGED


def test_debounce_over_unprotected_frames_needs_no_extra_reads() -> None:
    """With unprotected frames a debounce time needs no additional reads."""
    bank = BankTracker(confirm=True, debounce_s={1: 0.25})
    publish_all(bank, [0, 0])
    outcomes = [bank.observe(1, at) for at in (1.0, 1.1, 1.2, 1.3, 1.4)]
    assert outcomes == [
        Outcome.READ_AGAIN,
        Outcome.UNCHANGED,
        Outcome.UNCHANGED,
        Outcome.UNCHANGED,
        Outcome.CHANGED,
    ]


def test_after_the_module_was_away_the_next_value_is_a_first_value() -> None:
    """After an absence of the module the next value is a first value."""
    bank = BankTracker(confirm=True, debounce_s={1: 0.25})
    publish_all(bank, [0, 0, 1])
    bank.forget()
    assert bank.value is None
    assert publish_all(bank, [1, 1]) == [1]


# --- where somebody else asks too -----------------------------------------------------------------

APART_S = 0.5


def test_equal_replies_that_follow_each_other_prove_nothing() -> None:
    """Another master is told the same again and again: they have to lie apart (F12)."""
    bank = BankTracker(confirm=True)
    assert bank.observe(5, 0.0, apart_s=APART_S) is Outcome.READ_AGAIN
    taken = [bank.observe(5, n / 10, apart_s=APART_S) for n in range(1, 21)]
    assert taken == [Outcome.READ_LATER] * 19 + [Outcome.CHANGED]
    assert bank.value == 5


def test_one_other_reply_between_them_begins_anew() -> None:
    """Ours and theirs take turns: neither is believed."""
    bank = BankTracker(confirm=True)
    for n in range(200):
        assert bank.observe(7 if n % 5 == 4 else 5, n / 10, apart_s=APART_S) is not Outcome.CHANGED
    assert bank.value is None


def test_a_reply_that_says_whose_it_is_is_believed_at_once() -> None:
    """A reply with station and checksum is accepted at once."""
    bank = BankTracker(confirm=True)
    assert bank.observe(5, 0.0, apart_s=float("inf")) is Outcome.READ_AGAIN
    assert bank.is_waiting
    assert bank.observe(5, 99.0, apart_s=float("inf")) is Outcome.READ_LATER
    assert bank.observe(6, 99.1, protected=True) is Outcome.CHANGED
    assert bank.value == 6
