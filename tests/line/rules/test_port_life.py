"""The times at which a port is opened again, and at which changes are published."""

from itertools import pairwise

import pytest

from bridge.line.rules.port_life import (
    RENEW_FIRST_S,
    RENEW_LAST_S,
    REOPEN_LAST_S,
    TRIAL_FIRST_S,
    TRIAL_LAST_S,
    PortLife,
)

STEP_S = 0.05
DAY_S = 24 * 3600.0


class Line:
    """A port whose connections hold and whose openings fail as the test says.

    Attributes:
        told: When the line was told to be there, and to be gone.
        opened: When it was opened, or in vain.
    """

    def __init__(self, *, gateway: bool) -> None:
        self.life = PortLife(gateway=gateway)
        self.now = 0.0
        self.told: list[tuple[float, bool]] = []
        self.opened: list[float] = []
        self._is_open = False

    def live(self, until: float, *, there: bool) -> None:
        """Time passes while the far side is there, or is not."""
        if not there:
            self._lose()
        while self.now < until:
            if not self._is_open and self.now >= self.life.open_at:
                self._open(there=there)
            self._tick()
            self.now += STEP_S

    def drop(self) -> None:
        """The far side drops the connection, if there is one."""
        self._lose()
        self._tick()

    def changes(self) -> list[bool]:
        """Return the published changes, in order."""
        return [online for _, online in self.told]

    def _open(self, *, there: bool) -> None:
        self.opened.append(self.now)
        if there:
            self._is_open = True
            self.life.opened(self.now)
            self.life.is_used = True
            self.life.recovered()
        else:
            self.life.lost(self.now)

    def _lose(self) -> None:
        if self._is_open:
            self._is_open = False
            self.life.lost(self.now)

    def _tick(self) -> None:
        if self.life.is_down_due(self.now) and not self.life.is_used:
            self._tell(online=False)
        if self.life.is_up_due(self.now):
            self._tell(online=True)

    def _tell(self, *, online: bool) -> None:
        if self.life.online is not online:
            self.told.append((self.now, online))
        self.life.told(self.now, online=online)


@pytest.mark.parametrize("gateway", [True, False])
@pytest.mark.parametrize("period_s", [0.5, 1.0, 3.0, 10.0, 30.0, 60.0])
def test_who_comes_and_goes_is_not_told_each_time(period_s: float, *, gateway: bool) -> None:
    """A port that comes and goes is published as online only after it held (F16)."""
    line = Line(gateway=gateway)
    line.live(30.0, there=True)
    end = line.now + 3600.0
    while line.now < end:
        line.live(line.now + period_s / 2, there=False)
        line.live(line.now + period_s / 2, there=True)
    flaps = 3600.0 / period_s
    trial_s = TRIAL_LAST_S if gateway else TRIAL_FIRST_S
    if period_s / 2 < trial_s + STEP_S:
        assert len(line.told) <= 12
    assert len(line.told) <= 2 * flaps + 2
    line.live(line.now + 2 * TRIAL_LAST_S, there=True)
    assert line.changes()[-1]


def test_long_after_it_flapped_it_is_told_at_once_again() -> None:
    """Long after it flapped, a loss is published at once again."""
    line = Line(gateway=True)
    for _ in range(20):
        line.live(line.now + 5.0, there=False)
        line.live(line.now + 5.0, there=True)
    line.live(line.now + 150.0, there=True)
    line.live(line.now + 10.0, there=False)
    back_at = line.now
    line.live(line.now + 10.0, there=True)
    assert line.told[-1][1]
    assert line.told[-1][0] - back_at <= REOPEN_LAST_S + 0.1


def test_a_port_is_tried_every_two_seconds_at_the_most() -> None:
    """A port is tried at most every two seconds, however long it stays away."""
    line = Line(gateway=True)
    line.live(60.0, there=False)
    assert 28 <= len(line.opened) <= 34
    for _ in range(100):
        line.live(line.now + 0.5, there=True)
        line.drop()
    assert len(line.opened) <= 34 + 50


def test_the_close_of_a_connection_that_nobody_uses_is_no_error() -> None:
    """A gateway that closes an unused connection causes no error (F19)."""
    life = PortLife(gateway=True)
    life.opened(0.0)
    assert not life.is_idle_close(10.0, anybody=False)  # nothing was told of it yet
    life.told(0.5, online=True)
    assert not life.is_idle_close(1.0, anybody=False)
    assert not life.is_idle_close(10.0, anybody=True)
    assert life.is_idle_close(10.0, anybody=False)
    device = PortLife(gateway=False)
    device.opened(0.0)
    device.told(0.5, online=True)
    assert not device.is_idle_close(10.0, anybody=False)


def test_a_connection_on_which_all_fell_silent_is_opened_anew() -> None:
    """At once, and then ever more rarely (docs/failures.md F20)."""
    life, now = PortLife(gateway=True), 0.0
    life.opened(now)
    life.heard(50.0)
    now, anew = 50.1, []
    while now < DAY_S:
        if life.is_deaf(now):
            anew.append(now)
            life.opened(now)
        now += 0.5
    pauses = [later - earlier for earlier, later in pairwise(anew)]
    assert anew[0] == 50.1
    assert pauses[0] == pytest.approx(RENEW_FIRST_S, abs=0.6)
    assert pauses[-1] == pytest.approx(RENEW_LAST_S, abs=0.6)
    assert len(anew) < DAY_S / RENEW_LAST_S + 10


def test_a_device_is_not_opened_anew() -> None:
    """A local device is never opened again as deaf."""
    life = PortLife(gateway=False)
    life.opened(0.0)
    assert not life.is_deaf(DAY_S)


def test_what_repeats_is_worth_a_line_once_in_ten_minutes() -> None:
    """Drops that are mended, and silence."""
    life = PortLife(gateway=True)
    life.opened(0.0)
    assert [life.may_tell_drop(at) for at in (1.0, 2.0, 600.0, 601.5)] == [True, False, False, True]
    assert [life.may_tell_silence(at) for at in (1.0, 2.0, 601.5)] == [True, False, True]
    for n in range(10):
        life.opened(1000.0 * n)
    assert not life.may_tell_silence(20_000.0)
