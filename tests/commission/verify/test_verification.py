"""What verify measures and proposes, on simulated modules in virtual time."""

import pytest
from proofs.verified_line import PULSE_OUTPUT, verified

from bridge.commission.verify.assumptions import ASSUMPTIONS, FindingWord
from bridge.commission.verify.sampling import upper_bound
from bridge.commission.verify.verification import fails, unheard
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.dialect import Dialect
from bridge.simulator.faults import is_write


@pytest.mark.parametrize("protocol", LineProtocol)
def test_without_an_output_no_frame_writes(protocol: LineProtocol) -> None:
    """Reads alone are sent, and no module is asked at address 0."""
    seen = verified(protocol, (DIO100, DO100), samples=20)
    frames = [frame for _, frame in seen.panel.sent]
    assert frames
    assert not [frame for frame in frames if is_write(frame)]
    assert {station["address"] for station in seen.document["stations"]} == {1, 2}


@pytest.mark.parametrize("protocol", LineProtocol)
def test_an_output_that_is_named_is_off_at_the_end(protocol: LineProtocol) -> None:
    """Only that output was switched."""
    seen = verified(protocol, (DIO100,), samples=20, output=PULSE_OUTPUT)
    module = seen.panel.modules[1]
    assert seen.words["off-in-pulse"] == FindingWord.AS_ASSUMED
    assert not module.outputs
    assert {one.output for one in module.switchings} == {PULSE_OUTPUT}


def test_a_latch_is_not_switched() -> None:
    """Only a pulse shows something: a latch is left as it is."""
    seen = verified(LineProtocol.WISCO, (DIO100,), samples=20, output=None)
    assert seen.words["second-on"] == FindingWord.NOT_TRIED


def test_each_assumption_has_one_finding() -> None:
    """None is left out, and they come in the order of docs/protocol.md."""
    assert list(verified(LineProtocol.WISCO, (DIO100,), samples=20).words) == list(ASSUMPTIONS)


def test_what_the_bridge_relies_on_fails() -> None:
    """A module that is slow is a failure; one that writes lower case is not."""
    slow = verified(LineProtocol.WISCO, (DIO100,), Dialect.SLOW, samples=20).document
    lower = verified(LineProtocol.WISCO, (DIO100,), Dialect.LOWER_HEX, samples=20).document
    assert fails(slow) == [("s1", "turnaround")]
    assert fails(lower) == []
    assert unheard(slow) == []


def test_slow_modules_get_a_longer_time_out() -> None:
    """What was seen is covered with a margin, and the late window is never made shorter."""
    seen = verified(LineProtocol.WISCO, (DIO100,), Dialect.VERY_SLOW, samples=20).document
    settings = {one["name"]: one["value"] for one in seen["settings"]}
    assert settings["turnaround"] == "252ms"
    assert 0.315 < float(settings["timeout"].removesuffix("ms")) / 1000 < 0.6
    assert float(settings["late_window"].removesuffix("ms")) >= 300


def test_the_line_feed_of_cr_lf_is_no_noise() -> None:
    """It is a finding of its own, and no error of the cable."""
    seen = verified(LineProtocol.WISCO, (DIO100,), Dialect.CRLF, samples=20)
    assert seen.words["line-end"] == FindingWord.DIFFERS
    assert seen.document["errors"]["idle_bytes"] == 0
    assert seen.document["errors"]["garbled"] == 0


@pytest.mark.parametrize(
    ("failed", "asked", "bound"),
    [(0, 100, 0.0295), (1, 100, 0.0466), (0, 1000, 0.0030), (5, 5, 1.0), (0, 0, 1.0)],
)
def test_the_bound_of_the_error_rate(failed: int, asked: int, bound: float) -> None:
    """Clopper and Pearson, one-sided, 95 %."""
    assert upper_bound(failed, asked) == pytest.approx(bound, abs=0.0001)
