import pytest
from support.virtual_line import Fault, VirtualLine
from support.virtual_worker import make_line, make_station

from bridge.errors import BadReplyError, NoReplyError, PortError, RefusedError
from bridge.line.actions.contact import make_contact
from bridge.line.station import Station
from bridge.model import DIO100, DO100, LineProtocol, ModuleType, OutputSettings, Writes
from bridge.simulator.faults import is_write
from bridge.simulator.module import SimulatedModule

WAYS = [
    (LineProtocol.WISCO, Writes.AUTO),
    (LineProtocol.WISCO, Writes.WISCO),
    (LineProtocol.WISCO, Writes.MODBUS),
    (LineProtocol.MODBUS_RTU, Writes.AUTO),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO),
]
every_way = pytest.mark.parametrize(("protocol", "writes"), WAYS)


class Meeting:
    """One station as configured, and the module that is really there."""

    def __init__(
        self,
        protocol: LineProtocol = LineProtocol.WISCO,
        writes: Writes = Writes.AUTO,
        *,
        model: ModuleType = DIO100,
        there: ModuleType | None = None,
        wisco_only: bool = False,
        address: int = 1,
    ) -> None:
        config = make_line(make_station(address, model), protocol=protocol, writes=writes)
        self.line = VirtualLine(config, wisco_only=wisco_only)
        if there is not None:
            self.line.modules[address] = SimulatedModule(there, address, clock=self.line.clock)
        self.module = self.line.modules[address]
        self.station = Station(config.stations[0], config)

    def make(self) -> str | None:
        """Makes contact; whatever came of it, nothing was written."""
        try:
            return make_contact(self.station, self.line, self.line.clock)
        finally:
            assert not any(is_write(frame) for _, frame in self.line.wire)

    def faults(self, *faults: Fault | None) -> None:
        """Return the faults of the first exchanges."""
        left = list(faults)
        self.line.fault = lambda _: left.pop(0) if left else None


@every_way
@pytest.mark.parametrize("model", [DIO100, DO100])
def test_contact_reads_values_and_settings(
    protocol: LineProtocol, writes: Writes, model: ModuleType
) -> None:
    """All is known before the module is called online; `writes: wisco` asks for no settings."""
    meeting = Meeting(protocol, writes, model=model)
    meeting.module.set_output(2, True)
    meeting.module.set_mode(5, pulse=True, hold_s=2.5)
    if model.inputs:
        meeting.module.set_input(16, True)
    assert meeting.make() is None
    assert meeting.station.inputs.value == (0x8000 if model.inputs else 0)
    assert meeting.station.outputs.value == 0b10
    known = writes is not Writes.WISCO
    assert meeting.station.settings == (meeting.module.settings if known else None)
    assert meeting.station.takes_modbus is known


@every_way
@pytest.mark.parametrize(("model", "there"), [(DIO100, DO100), (DO100, DIO100)])
def test_the_wrong_model_is_told_by_an_input_read(
    protocol: LineProtocol, writes: Writes, model: ModuleType, there: ModuleType
) -> None:
    """Two equal answers, and nothing is taken from a module that is not the one meant."""
    meeting = Meeting(protocol, writes, model=model, there=there)
    complaint = meeting.make()
    assert complaint is not None
    assert complaint.startswith(f"configured as {model.name}")
    assert len(meeting.line.wire) == 2
    assert meeting.station.outputs.value is None


@pytest.mark.parametrize("model", [DIO100, DO100])
def test_one_odd_answer_does_not_make_a_wrong_model(model: ModuleType) -> None:
    """The first answer came of noise, the second says what it is."""
    meeting = Meeting(LineProtocol.WISCO, model=model)
    odd = DO100 if model is DIO100 else DIO100
    twin = SimulatedModule(odd, 1, clock=meeting.line.clock)
    modules, true_one = meeting.line.modules, meeting.module

    def fault(_: bytes) -> None:
        modules[1] = true_one if meeting.line.wire else twin

    meeting.line.fault = fault
    assert meeting.make() is None


def test_a_refusal_for_another_reason_says_nothing_about_the_model() -> None:
    """`ERR=3` to an input read is noise in the request: asked again another time."""
    meeting = Meeting(LineProtocol.WISCO)
    meeting.faults(Fault.REFUSE)
    with pytest.raises(RefusedError):
        meeting.make()


@every_way
def test_a_dead_module_costs_one_exchange(protocol: LineProtocol, writes: Writes) -> None:
    """The first time-out ends the contact: docs/contract.md, promise 7."""
    meeting = Meeting(protocol, writes)
    meeting.module.away = True
    with pytest.raises(NoReplyError):
        meeting.make()
    assert len(meeting.line.wire) == 1


def test_a_module_without_modbus_is_asked_three_times() -> None:
    """After three Modbus reads without an answer, writes go as Wisco frames (promise 6)."""
    meeting = Meeting(wisco_only=True)
    assert meeting.make() is None
    assert sum(frame.startswith(b":") for _, frame in meeting.line.wire) == 3
    assert not meeting.station.takes_modbus
    assert meeting.station.writer is meeting.station.reader
    assert meeting.station.settings is None
    assert meeting.station.maybe_pulse == 0xFF


@pytest.mark.parametrize("lost", [1, 2])
def test_a_lost_answer_to_the_modbus_question_changes_nothing(lost: int) -> None:
    """One answer of three is enough."""
    meeting = Meeting()
    meeting.faults(None, *[Fault.LOSE_REPLY] * lost)
    assert meeting.make() is None
    assert meeting.station.takes_modbus
    assert meeting.station.settings is not None


def test_a_module_that_refuses_the_question_takes_modbus_all_the_same() -> None:
    """A valid "no" in a Modbus frame, three times, is Modbus; the modes stay unknown."""
    meeting = Meeting()
    meeting.faults(None, Fault.REFUSE, Fault.REFUSE, Fault.REFUSE)
    assert meeting.make() is None
    assert meeting.station.takes_modbus
    assert meeting.station.settings is None


def test_forced_modbus_stays_modbus_when_it_is_not_answered() -> None:
    """`writes: modbus` is the owner's word; the modes are unknown then."""
    meeting = Meeting(writes=Writes.MODBUS, wisco_only=True)
    assert meeting.make() is None
    assert meeting.station.takes_modbus
    assert meeting.station.settings is None


def test_station_0_is_never_asked_in_modbus_frames() -> None:
    """Address 0 is the broadcast: docs/contract.md, promise 6; docs/failures.md A9."""
    meeting = Meeting(address=0)
    assert meeting.make() is None
    assert not any(frame.startswith(b":") for _, frame in meeting.line.wire)
    assert not meeting.station.takes_modbus


def test_a_first_value_over_unprotected_frames_is_read_twice_in_a_row() -> None:
    """A flipped bit in the first reply is not the first value (promise 5)."""
    meeting = Meeting(writes=Writes.WISCO)
    meeting.faults(None, Fault.FLIP_REPLY)
    assert meeting.make() is None
    assert meeting.station.inputs.value == 0
    assert len(meeting.line.wire) == 1 + 3 + 2


def test_values_that_never_agree_are_no_first_value() -> None:
    """Contact fails, to be made again later."""
    meeting = Meeting(writes=Writes.WISCO)
    channel = iter(range(1, 17))
    meeting.line.fault = lambda _: meeting.module.set_input(next(channel), True)
    with pytest.raises(BadReplyError, match="agreed"):
        meeting.make()
    assert meeting.station.inputs.value is None


def test_a_port_that_goes_ends_the_contact() -> None:
    """The port's owner hears of it."""
    meeting = Meeting()
    meeting.faults(None, Fault.PORT_GONE)
    with pytest.raises(PortError):
        meeting.make()


def test_forgetting_a_module_leaves_nothing_of_it() -> None:
    """After `forget` nothing of the old module is known."""
    meeting = Meeting()
    assert meeting.make() is None
    meeting.station.forget()
    station = meeting.station
    assert (station.inputs.value, station.outputs.value, station.settings) == (None, None, None)
    assert not station.takes_modbus


@pytest.mark.parametrize("settings", [None, OutputSettings(0, (10,) * 8)])
def test_nothing_declared_never_differs(settings: OutputSettings | None) -> None:
    """Only what the configuration declares is compared."""
    station = Meeting().station
    station.settings = settings
    assert station.differing_settings() is None


# --- a module that was here before ----------------------------------------------------------------


def test_a_silent_module_is_first_asked_in_frames_that_cost_no_late_window() -> None:
    """A knock in vain is the whole contact; one that is answered comes before the usual reads."""
    meeting = Meeting()
    meeting.station.took_modbus = True
    meeting.module.away = True
    with pytest.raises(NoReplyError):
        meeting.make()
    assert [frame for _, frame in meeting.line.wire] == [b":010200000010ED\r\n"]
    assert meeting.line.quiet_until < meeting.line.now
    meeting.module.away = False
    assert meeting.make() is None
    assert [frame for _, frame in meeting.line.wire][1:3] == [b":010200000010ED\r\n", b"#01RDIH\r"]


def test_a_knock_that_is_refused_was_heard() -> None:
    """A DO100 has no inputs to read: it is there."""
    meeting = Meeting(model=DO100)
    meeting.station.took_modbus = True
    assert meeting.make() is None


@pytest.mark.parametrize(
    ("took", "knocks"),
    [
        (True, [True, True, True, False, True, True, True, False]),
        (None, [False, True, True, True, False, True, False, False]),
        (False, [False] * 8),
    ],
)
def test_now_and_then_a_silent_module_is_asked_in_wisco_frames(
    took: bool | None, knocks: list[bool]
) -> None:
    """It may be another one by now. There is no knock if it took no Modbus frames before.

    One that was never met is asked in Wisco frames at least each 30 s, as its pauses become longer.
    """
    station = Meeting().station
    station.took_modbus = took
    seen = []
    for station.vain_contacts in range(8):
        seen.append(station.knocker is not None)
    assert seen == knocks


@pytest.mark.parametrize(
    ("protocol", "writes"), [(LineProtocol.WISCO, Writes.WISCO), (LineProtocol.MODBUS_RTU, None)]
)
def test_there_is_no_knock_where_it_gains_nothing(
    protocol: LineProtocol, writes: Writes | None
) -> None:
    """Modbus lines have no late window for others, and `writes: wisco` sends no Modbus frame."""
    station = Meeting(protocol, writes or Writes.AUTO).station
    station.took_modbus = True
    assert station.knocker is None


# --- where somebody else asks too -----------------------------------------------------------------


def contested(*, wisco_only: bool) -> Meeting:
    """Replies to another master are about on the line."""
    meeting = Meeting(wisco_only=wisco_only)
    config = make_line(make_station())
    meeting.station = Station(config.stations[0], config, lambda: True)
    meeting.module.set_input(3, True)
    return meeting


def test_on_a_contested_line_all_is_asked_in_frames_that_say_whose_they_are() -> None:
    """Model, values and settings, each once (docs/failures.md F12)."""
    meeting = contested(wisco_only=False)
    assert meeting.make() is None
    assert meeting.station.inputs.value == 4
    frames = [frame for _, frame in meeting.line.wire]
    assert all(frame.startswith(b":") for frame in frames)
    assert len(frames) == len(set(frames)) + 1  # the inputs tell the model, and their values


def test_a_module_that_takes_no_such_frames_is_asked_for_longer() -> None:
    """With another master a Wisco-only module is read four times, some time apart."""
    meeting = contested(wisco_only=True)
    reads = 0

    def fault(frame: bytes) -> Fault | None:
        nonlocal reads
        reads += frame == b"#01RDIH\r"
        return Fault.FLIP_REPLY if reads == 3 else None

    meeting.line.fault = fault
    began = meeting.line.now
    assert meeting.make() is None
    assert meeting.station.inputs.value == 4
    assert meeting.line.now - began > 4.0
