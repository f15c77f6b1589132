import pytest
from support.commands import make_command
from support.house import GARAGE

from bridge.hub.admission import RateLimit, SeenIds, StationGate
from bridge.model import Reason, Word


def test_an_id_is_a_repeat_for_sixty_seconds() -> None:
    """The same id within 60 s is a repeat; later, or another, is not (docs/failures.md A4)."""
    seen = SeenIds()
    assert not seen.is_repeat("x1", 0.0)
    assert not seen.is_repeat("x2", 1.0)
    assert seen.is_repeat("x1", 59.9)
    assert not seen.is_repeat("x1", 60.0)
    assert seen.is_repeat("x2", 60.9)
    assert not seen.is_repeat("x2", 61.0)
    assert not seen.is_repeat(1, 61.0)
    assert not seen.is_repeat("1", 61.0)  # a number and a word are different ids


def test_a_flood_of_ids_takes_bounded_memory() -> None:
    """The oldest are forgotten first."""
    seen = SeenIds()
    for n in range(60_000):
        seen.is_repeat(n, 0.0)
    assert seen.is_repeat(59_999, 0.0)
    assert not seen.is_repeat(0, 0.0)


def test_a_rate_limit_admits_a_seconds_worth_at_once_and_then_its_rate() -> None:
    """10,000 commands in 1 s: at most the limit and its burst (docs/failures.md A15)."""
    limit = RateLimit(20.0, now=0.0)
    assert sum(limit.admits(0.0) for _ in range(100)) == 20
    assert sum(limit.admits(n / 10_000) for n in range(10_000)) == pytest.approx(20, abs=1)


def test_a_slow_rate_admits_one_command_at_a_time() -> None:
    """A limit below one a second is no ban."""
    limit = RateLimit(0.5, now=0.0)
    assert limit.admits(0.0)
    assert not limit.admits(1.9)
    assert limit.admits(2.0)


def test_a_gate_names_its_objection() -> None:
    """Read-only, wrong model, offline, rate: the first that holds."""
    gate = StationGate(GARAGE, now=0.0)
    gate.wrong_model = True
    assert gate.objection(make_command(0b110, 0), 0.0) is Reason.READ_ONLY
    assert gate.objection(make_command(1, 1), 0.0) is Reason.WRONG_MODEL
    gate.wrong_model = False
    assert gate.objection(make_command(1, 1), 0.0) is Reason.OFFLINE
    gate.online = True
    for _ in range(20):
        assert gate.objection(make_command(1, 1), 0.0) is None
    assert gate.objection(make_command(1, 1), 0.0) is Reason.RATE_LIMITED


def test_words_for_latches_are_never_too_many() -> None:
    """ON for what was read as a latch, and OFF; ON for a pulse or TOGGLE has a rate."""
    gate = StationGate(GARAGE, now=0.0)
    gate.online = True
    gate.read_pulse(0b1000)
    latch, off = make_command(1, 1), make_command(0b1001, 0)
    for _ in range(100):
        assert gate.objection(latch, 0.0) is gate.objection(off, 0.0) is None
    for limited in (make_command(0b1000, 0b1000), make_command(1, 0, word=Word.TOGGLE)):
        gate = StationGate(GARAGE, now=0.0)
        gate.online = True
        gate.read_pulse(0b1000)
        reasons = [gate.objection(limited, 0.0) for _ in range(21)]
        assert reasons == [None] * 20 + [Reason.RATE_LIMITED]


def test_refused_commands_use_up_no_rate() -> None:
    """A sender whose module was away is not punished when it is back."""
    gate = StationGate(GARAGE, now=0.0)
    for _ in range(100):
        assert gate.objection(make_command(1, 1), 0.0) is Reason.OFFLINE
    gate.online = True
    assert gate.objection(make_command(1, 1), 0.0) is None


def test_pulse_outputs_are_those_declared_and_those_read() -> None:
    """Outputs count as pulses if declared or read so; a later read replaces the earlier one."""
    gate = StationGate(GARAGE, now=0.0)
    assert (gate.pulse, gate.pressable) == (0b10, 0b10)
    gate.read_pulse(0b1000)
    assert (gate.pulse, gate.pressable) == (0b1010, 0b1000)
    gate.read_pulse(0)
    assert (gate.pulse, gate.pressable) == (0b10, 0)
    gate.read_pulse(None)
    assert (gate.pulse, gate.pressable) == (0b10, 0b10)
