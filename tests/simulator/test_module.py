"""The module itself: channels, pulses on a clock of the test's, EEPROM."""

import pytest
from support.virtual_conversation import VirtualClock

from bridge.model import DIO100, DO100, ModuleType, OutputSettings
from bridge.simulator import SimulatedModule, Switching
from bridge.simulator.module import SETTINGS_AT, SWITCHINGS_KEPT

FRAME = b"#01WDO1,1\r"


@pytest.fixture
def clock() -> VirtualClock:
    """A clock that stands until the test moves it."""
    return VirtualClock()


@pytest.fixture
def module(clock: VirtualClock) -> SimulatedModule:
    """A DIO100 whose output 2 pulses for 2.5 s."""
    module = SimulatedModule(DIO100, address=1, clock=clock)
    module.set_mode(2, pulse=True, hold_s=2.5)
    return module


def test_inputs_follow_their_wires(module: SimulatedModule) -> None:
    """Inputs are bits, input 1 the lowest; each is set and turned over alone."""
    module.set_input(1, True)
    module.set_input(16, True)
    module.toggle_input(16)
    module.toggle_input(3)
    assert module.inputs == 0b101


@pytest.mark.parametrize("channel", [0, 17])
def test_input_that_is_not_there(module: SimulatedModule, channel: int) -> None:
    """A test that drives a channel which the model lacks hears of it."""
    with pytest.raises(ValueError, match=f"no input {channel}: this module has 16"):
        module.set_input(channel, True)


def test_do100_has_no_inputs() -> None:
    """A DO100 has outputs alone."""
    with pytest.raises(ValueError, match="no input 1"):
        SimulatedModule(DO100, address=1).toggle_input(1)


def test_latch_output_stays(module: SimulatedModule, clock: VirtualClock) -> None:
    """An output in latch mode stays as it was switched."""
    module.write_outputs(0b1, 0b1, FRAME)
    clock.now += 1000
    assert module.outputs == 0b1


def test_pulse_ends_by_itself(module: SimulatedModule, clock: VirtualClock) -> None:
    """An output in pulse mode goes OFF when its hold time is over, and not before."""
    module.write_outputs(0b11, 0b11, FRAME)
    clock.now += 2.499
    assert module.outputs == 0b11
    clock.now += 0.002
    assert module.outputs == 0b01


def test_pulse_end_is_recorded_at_its_own_time(
    module: SimulatedModule, clock: VirtualClock
) -> None:
    """The end of a pulse is recorded with its own time, not that of the call."""
    module.write_outputs(0b10, 0b10, FRAME)
    clock.now += 60
    module.settle()
    assert list(module.switchings) == [
        Switching(100.0, 2, True, FRAME, True),
        Switching(102.5, 2, False, b"", True),
    ]


def test_new_on_restarts_the_hold_time(module: SimulatedModule, clock: VirtualClock) -> None:
    """ON while the pulse runs makes it last a whole hold time from then on."""
    module.write_outputs(0b10, 0b10, FRAME)
    clock.now += 2.0
    module.write_outputs(0b10, 0b10, FRAME)
    clock.now += 2.4
    assert module.outputs == 0b10
    clock.now += 0.2
    assert module.outputs == 0


def test_off_ends_a_pulse(module: SimulatedModule, clock: VirtualClock) -> None:
    """OFF ends a running pulse, and its end is not recorded a second time."""
    module.write_outputs(0b10, 0b10, FRAME)
    module.write_outputs(0b10, 0, FRAME)
    clock.now += 10
    assert module.outputs == 0
    assert [(each.output, each.value) for each in module.switchings] == [(2, True), (2, False)]


def test_running_pulse_is_left_alone_by_other_outputs(
    module: SimulatedModule, clock: VirtualClock
) -> None:
    """A write that does not name a pulsing output does not move its end."""
    module.write_outputs(0b10, 0b10, FRAME)
    clock.now += 2.0
    module.write_outputs(0b1, 0b1, FRAME)
    clock.now += 0.6
    assert module.outputs == 0b1


def test_settle_tells_when_the_next_pulse_ends(
    module: SimulatedModule, clock: VirtualClock
) -> None:
    """`settle` returns the time to the next end of a pulse; None without one."""
    assert module.settle() is None
    module.set_mode(1, pulse=True, hold_s=0.5)
    module.write_outputs(0b11, 0b11, FRAME)
    clock.now += 0.2
    assert module.settle() == pytest.approx(0.3)


def test_orders_are_counted(module: SimulatedModule, clock: VirtualClock) -> None:
    """Each order of a frame counts, one that changes nothing too; pulse ends and hands do not."""
    for _ in range(3):
        module.write_outputs(0b10, 0b10, FRAME)
    clock.now += 10
    module.settle()
    module.set_output(2, True)
    assert module.ordered == {(2, True): 3}
    assert [each.changed for each in module.switchings] == [True, False, False, True, True]


def test_switchings_are_bounded(module: SimulatedModule) -> None:
    """The record of switchings forgets the oldest."""
    for number in range(SWITCHINGS_KEPT + 10):
        module.set_output(1, bool(number % 2))
    assert len(module.switchings) == SWITCHINGS_KEPT


def test_listener_hears_of_each_switching(clock: VirtualClock) -> None:
    """The listener is called for each order and each end of a pulse, with the station."""
    heard: list[tuple[int, Switching]] = []
    module = SimulatedModule(
        DO100, 5, clock=clock, listener=lambda *switching: heard.append(switching)
    )
    module.set_output(16, True)
    assert heard == [(5, Switching(100.0, 16, True, b"", True))]


@pytest.mark.parametrize(("model", "mode"), [(DIO100, 0xFF00), (DO100, 0x0000)])
def test_settings_as_from_the_factory(model: ModuleType, mode: int) -> None:
    """All latch, all hold times 1.0 s; the DIO100's don't-care byte is set, to be masked."""
    module = SimulatedModule(model, address=1)
    assert module.settings == OutputSettings(0, (10,) * model.outputs)
    assert module.read_eeprom(SETTINGS_AT, 4) == mode.to_bytes(2, "big") + b"\x00\x0a"


def test_high_byte_of_a_dio100_mode_does_nothing() -> None:
    """Mode bits above output 8 of a DIO100 make nothing pulse."""
    module = SimulatedModule(DIO100, address=1)
    module.write_eeprom(SETTINGS_AT, b"\xab\x01")
    assert module.settings.pulse == 0x01


@pytest.mark.parametrize(("stored", "acts_as"), [(b"\x00\x00", 1), (b"\x01\x00", 255)])
def test_hold_time_out_of_range_acts_as_the_nearest(stored: bytes, acts_as: int) -> None:
    """A raw EEPROM write can store any hold time; the module does not choke on it."""
    module = SimulatedModule(DIO100, address=1)
    module.write_eeprom(SETTINGS_AT + 2, stored)
    assert module.settings.hold_ds[0] == acts_as


def test_eeprom_writes_are_counted() -> None:
    """Tests can tell that nothing wore the EEPROM out; a hand's settings do not count."""
    module = SimulatedModule(DIO100, address=1)
    module.set_mode(1, pulse=True, hold_s=0.1)
    assert module.eeprom_writes == 0
    module.write_eeprom(0, b"\x01\x02")
    assert module.eeprom_writes == 1
    assert module.read_eeprom(0, 3) == b"\x01\x02\xff"
