import pytest
from support.commands import make_command
from support.covers import with_cover
from support.fake_worker import FakeWorker
from support.house import make_config

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.hub.counts import Counts
from bridge.hub.hub import Hub
from bridge.model import (
    AnyCommand,
    Command,
    CoverChanged,
    CoverCommand,
    CoverState,
    ExchangeCounts,
    Gesture,
    GestureMade,
    InputsRose,
    LineChanged,
    LineMeasured,
    LossOrderMade,
    OutputSettings,
    ProblemChanged,
    PublicEvent,
    Reason,
    ReplyTo,
    Setting,
    SettingCommand,
    SettingsRead,
    StateEvent,
    StationChanged,
    StationMeasured,
    Status,
    ValuesChanged,
    Verdict,
    Word,
)

COUNTS = ExchangeCounts(1, 0, 0, 0)
SETTINGS = OutputSettings(pulse=0b1000, hold_ds=(10,) * 8)
OPEN = CoverCommand(
    "garage", "cover/shutter", "OPEN", "shutter", 0b11, 100, arrived=100.0, deadline=102.0, id="x"
)


class Bench:
    """A hub between a recording publisher and a fake line."""

    def __init__(self, config: Config | None = None, *, online: bool = True) -> None:
        self.now = 100.0
        self.told: list[PublicEvent] = []
        self.line = FakeWorker(make_config().lines[0])
        current = CurrentConfig(config or make_config())
        counts = Counts(current, self.told.append)
        self.hub = Hub(current, self.told.append, {"main": self.line}, counts, lambda: self.now)
        if online:
            self.hub.apply(StationChanged("garage", online=True, detail=""))
            self.told.clear()

    def submit(self, command: AnyCommand) -> Reason | None:
        """Submits; returns why it was refused, or None when the line got it."""
        told, let_through = len(self.told), len(self.line.commands)
        self.hub.submit(command)
        if self.line.commands[let_through:] == [command]:
            assert len(self.told) == told
            return None
        (verdict,) = self.told[told:]
        assert isinstance(verdict, Verdict)
        assert verdict.status is Status.REFUSED
        assert isinstance(verdict.reason, Reason)
        return verdict.reason


@pytest.mark.parametrize(
    "event",
    [
        LineChanged("main", online=False, detail="gone"),
        StationChanged("garage", online=True, detail=""),
        ValuesChanged("garage", 5, 9),
        GestureMade("garage", 3, Gesture.LONG),
        SettingsRead("garage", SETTINGS),
        SettingsRead("garage", None),
        ProblemChanged("garage", "wrong_model", "x"),
        ProblemChanged("garage", None, ""),
        CoverChanged("garage", "shutter", CoverState.OPENING, 42),
        Verdict("garage", "do/1", "ON", Status.DONE, 41),
        LineMeasured("main", None, 0.5, COUNTS, 0),
        StationMeasured("garage", None, None, 0.1, None, COUNTS, None, None),
    ],
)
def test_what_a_line_reports_is_published_as_it_is(event: StateEvent) -> None:
    """The hub changes nothing of an event, and judges nothing that was carried out."""
    bench = Bench(online=False)
    bench.hub.apply(event)
    assert bench.told == [event]


def test_what_the_hub_alone_needs_is_not_published() -> None:
    """An order that a loss of the broker made is remembered; an edge becomes a count."""
    bench = Bench(online=False)
    bench.hub.apply(LossOrderMade("garage", 1))
    bench.hub.apply(InputsRose("garage", 0b1))
    assert bench.told == []


def test_a_command_for_a_module_that_is_away_is_refused() -> None:
    """At once: it never waits for a dead module, nor for one that went away."""
    bench = Bench(online=False)
    assert bench.submit(make_command(1, 1)) is Reason.OFFLINE
    bench.hub.apply(StationChanged("garage", online=True, detail=""))
    assert bench.submit(make_command(1, 1)) is None
    bench.hub.apply(StationChanged("garage", online=False, detail="no reply"))
    assert bench.submit(make_command(1, 1)) is Reason.OFFLINE


def test_a_command_for_the_wrong_model_says_so() -> None:
    """Until the problem is over, and not for any other problem."""
    bench = Bench()
    bench.hub.apply(ProblemChanged("garage", "wrong_model", "a DO100"))
    assert bench.submit(make_command(1, 1)) is Reason.WRONG_MODEL
    bench.hub.apply(ProblemChanged("garage", "settings_differ", "output 2"))
    assert bench.submit(make_command(1, 1)) is None


def test_an_id_is_obeyed_once() -> None:
    """A repeat is a duplicate even where the first was refused; commands without id are not."""
    bench = Bench(online=False)
    assert bench.submit(make_command(1, 1, command_id="x1")) is Reason.OFFLINE
    bench.hub.apply(StationChanged("garage", online=True, detail=""))
    assert bench.submit(make_command(1, 1, command_id="x1")) is Reason.DUPLICATE
    assert bench.submit(make_command(1, 1)) is None
    assert bench.submit(make_command(1, 1)) is None
    bench.now += 61.0
    assert bench.submit(make_command(1, 1, command_id="x1")) is None


def test_press_is_for_pulses_and_toggle_for_latches() -> None:
    """Declared (output 2) or read (output 4): the other word is a bad payload."""
    bench = Bench()
    assert bench.submit(make_command(0b10, 0b10, word=Word.PRESS)) is None
    assert bench.submit(make_command(0b10, 0, word=Word.TOGGLE)) is Reason.BAD_PAYLOAD
    assert bench.submit(make_command(0b1000, 0, word=Word.TOGGLE)) is None
    assert bench.submit(make_command(0b1000, 0b1000, word=Word.PRESS)) is Reason.BAD_PAYLOAD
    bench.hub.apply(SettingsRead("garage", SETTINGS))
    assert bench.submit(make_command(0b1000, 0, word=Word.TOGGLE)) is Reason.BAD_PAYLOAD
    assert bench.submit(make_command(0b1000, 0b1000, word=Word.PRESS)) is None
    bench.hub.apply(SettingsRead("garage", None))
    assert bench.submit(make_command(0b1000, 0, word=Word.TOGGLE)) is None


def test_an_output_that_is_declared_a_pulse_and_latches_is_not_pressed() -> None:
    """It would stay ON: a gate that never lets go (its problem topic says what differs)."""
    bench = Bench()
    bench.hub.apply(SettingsRead("garage", SETTINGS))  # output 4 is the pulse, not output 2
    assert bench.submit(make_command(0b10, 0b10, word=Word.PRESS)) is Reason.BAD_PAYLOAD
    assert bench.submit(make_command(0b10, 0, word=Word.TOGGLE)) is Reason.BAD_PAYLOAD


def test_a_refusal_repeats_what_was_asked_and_where_to_answer() -> None:
    """Target, payload, id, response topic, and the time since the command arrived."""
    bench = Bench(online=False)
    reply_to = ReplyTo("answers/here", b"\x01")
    command = Command(
        "garage",
        "do/1",
        "ON",
        1,
        1,
        None,
        arrived=99.75,
        deadline=102.0,
        id="x7",
        reply_to=reply_to,
    )
    bench.hub.submit(command)
    assert bench.told == [
        Verdict(
            "garage",
            "do/1",
            "ON",
            Status.REFUSED,
            250,
            Reason.OFFLINE,
            id="x7",
            reply_to=reply_to,
        )
    ]


def make_setting(output: int, setting: Setting, command_id: str | None = None) -> SettingCommand:
    """A command to set something of an output of `garage`."""
    target = f"do/{output}/{setting}"
    return SettingCommand(
        "garage", target, 1, output, setting, 1, arrived=100.0, deadline=102.0, id=command_id
    )


def test_settings_and_covers_pass_the_same_gate() -> None:
    """Duplicates, read-only outputs, floods, a wrong model, a module that is away: all alike."""
    bench = Bench()
    assert bench.submit(make_setting(1, Setting.MODE, "x")) is None
    assert bench.submit(make_setting(1, Setting.MODE, "x")) is Reason.DUPLICATE
    assert bench.submit(make_setting(3, Setting.MODE)) is Reason.READ_ONLY
    reasons = [bench.submit(make_setting(1, Setting.HOLD)) for _ in range(30)]
    assert reasons[19:] == [Reason.RATE_LIMITED] * 11
    bench.hub.apply(ProblemChanged("garage", "wrong_model", "x"))
    bench.told.clear()
    assert bench.submit(make_setting(1, Setting.HOLD)) is Reason.WRONG_MODEL
    away = Bench(online=False)
    assert away.submit(make_setting(1, Setting.HOLD)) is Reason.OFFLINE
    assert away.submit(OPEN) is Reason.OFFLINE
    assert away.submit(OPEN) is Reason.DUPLICATE


def test_what_the_configuration_declares_is_not_set_by_command() -> None:
    """Output 2 is declared a pulse of 0.5 s, output 8 a latch of whatever hold time."""
    bench = Bench()
    for setting in Setting:
        assert bench.submit(make_setting(2, setting)) is Reason.READ_ONLY
    assert bench.submit(make_setting(8, Setting.MODE)) is Reason.READ_ONLY
    assert bench.submit(make_setting(8, Setting.HOLD)) is None


def test_the_outputs_of_a_cover_are_switched_on_by_the_cover_alone() -> None:
    """OFF stops it, so that is let through; a setting would take the latch away from it."""
    bench = Bench(with_cover(make_config()))
    assert bench.submit(OPEN) is None
    assert bench.submit(make_command(0b01, 0b01)) is Reason.READ_ONLY
    assert "command the cover" in str(bench.told[-1])
    assert bench.submit(make_command(0b1001, 0b1001)) is Reason.READ_ONLY
    assert bench.submit(make_command(0b01, 0, word=Word.TOGGLE)) is Reason.READ_ONLY
    assert bench.submit(make_command(0b1011, 0)) is None
    assert bench.submit(make_command(0b1011, 0b1000)) is None
    assert bench.submit(make_setting(1, Setting.HOLD)) is Reason.READ_ONLY
