"""Whole scans on simulated panels, in virtual time."""

from collections.abc import Collection

import pytest
from support.virtual_panel import VirtualPanel, collision
from support.virtual_port import VirtualPort, VirtualTime

from bridge.commission.findings import Clash, Finding, Found, Noise, dip_text
from bridge.commission.scan import Scan, ScanStep
from bridge.commission.survey import (
    BAUDS,
    PROTOCOLS,
    QUICK,
    QUICK_PROTOCOLS,
    STATIONS,
    THOROUGH,
    Effort,
    ScanPlan,
    survey_of,
)
from bridge.errors import PortError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.module import SimulatedModule
from bridge.transport.port import Port

ALL = survey_of(BAUDS, PROTOCOLS, STATIONS, THOROUGH)
# At a rate that is not the panel's nobody hears: one such rate shows what four do.
TWO_RATES = survey_of(BAUDS[:2], PROTOCOLS, STATIONS, THOROUGH)
FAST = survey_of(BAUDS, QUICK_PROTOCOLS, STATIONS, QUICK)
TWELVE = {address: (DIO100, DO100)[address % 4 // 2] for address in range(1, 24, 2)}


def twelve_modules() -> list[SimulatedModule]:
    """Return twelve modules of both models, at scattered addresses."""
    return [SimulatedModule(model, address) for address, model in TWELVE.items()]


def scan(panel: VirtualPanel, survey: ScanPlan, expect: int | None = None) -> Scan:
    """Scans a panel, and looks at the wire: no frame wrote."""
    done = Scan(survey, panel.open, lambda _: None, panel.time.clock, panel.time.sleep)
    done.run(expect)
    assert not [frame for _, frame in panel.sent if is_write(frame)]
    return done


def is_all_of_twelve(done: Scan) -> bool:
    """Return whether all twelve were found, and nothing else."""
    return {one.address: one.model for one in done.findings.found} == TWELVE and len(
        done.findings.found
    ) == 12


@pytest.mark.parametrize(
    ("survey", "baud", "protocol"),
    [
        *((FAST, baud, protocol) for baud in BAUDS for protocol in PROTOCOLS),
        *((TWO_RATES, BAUDS[0], protocol) for protocol in PROTOCOLS),
        (ALL, BAUDS[-1], PROTOCOLS[0]),
    ],
)
def test_all_twelve_are_found_and_nothing_else(
    protocol: LineProtocol, baud: int, survey: ScanPlan
) -> None:
    """All twelve are found at every setting, in little more than the time on the wire."""
    done = scan(VirtualPanel(protocol, baud, twelve_modules()), survey)
    assert is_all_of_twelve(done)
    assert {one.baud for one in done.findings.found} == {baud}
    assert (done.findings.clashes, done.findings.noises) == ([], [])
    assert done.least_s <= done.took_s < 1.1 * done.least_s


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("seed", range(5))
def test_a_thorough_scan_bears_lost_replies(protocol: LineProtocol, seed: int) -> None:
    """One reply in twenty is lost, and all twelve are found."""
    panel = VirtualPanel(protocol, 19200, twelve_modules(), seed=seed)
    panel.faults.set(FaultKind.SILENT, probability=0.05)
    done = scan(panel, TWO_RATES)
    assert panel.faults.struck[FaultKind.SILENT]
    assert is_all_of_twelve(done)
    assert done.findings.clashes == []


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_echo_is_no_answer(protocol: LineProtocol) -> None:
    """An adapter that returns what is sent makes no module, at no baud rate."""
    panel = VirtualPanel(protocol, 19200, twelve_modules())
    panel.faults.set(FaultKind.ECHO)
    done = scan(panel, TWO_RATES)
    assert is_all_of_twelve(done)
    assert (done.findings.clashes, done.findings.noises) == ([], [])


@pytest.mark.parametrize("fault", [FaultKind.FLIP, FaultKind.TRUNCATE, FaultKind.LATE])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_damage_makes_no_module_and_no_clash(fault: FaultKind, protocol: LineProtocol) -> None:
    """One reply in twenty is damaged or late: what answers once is not believed."""
    panel = VirtualPanel(protocol, 19200, twelve_modules())
    panel.faults.set(fault, probability=0.05)
    done = scan(panel, TWO_RATES)
    assert panel.faults.struck[fault]
    assert is_all_of_twelve(done)
    assert done.findings.clashes == []


def test_a_module_with_switch_8_on_is_one_module() -> None:
    """A module with switch 8 ON is listed once, for a Wisco line."""
    done = scan(VirtualPanel(LineProtocol.WISCO, 9600, [SimulatedModule(DIO100, 13)]), TWO_RATES)
    (one,) = done.findings.found
    assert one.protocols == (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
    assert one.protocol is LineProtocol.WISCO
    assert dip_text(one.switches) == "10110 10 1"


def test_a_module_that_is_first_heard_in_ascii_frames_is_the_same_module() -> None:
    """A module whose Wisco replies were lost in the first round is listed once."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, [SimulatedModule(DIO100, 5)])
    panel.faults.set(FaultKind.SILENT, only=lambda frame: frame.startswith(b"#"), times=4)
    survey = survey_of([9600], PROTOCOLS, STATIONS, Effort(tries=2, margin_s=0.05))
    done = scan(panel, survey)
    assert [one.protocols for one in done.findings.found] == [
        (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
    ]


def test_a_module_that_takes_no_modbus_frames_is_found_once() -> None:
    """A module that only takes Wisco frames is found once, also at station 0."""
    modules = [SimulatedModule(DO100, 0), SimulatedModule(DIO100, 7, wisco_only=True)]
    done = scan(VirtualPanel(LineProtocol.WISCO, 9600, modules), TWO_RATES)
    assert [(one.address, one.model, one.protocols) for one in done.findings.found] == [
        (0, DO100, (LineProtocol.WISCO,)),
        (7, DIO100, (LineProtocol.WISCO,)),
    ]


def test_modes_and_hold_times_are_read() -> None:
    """The configuration will tell them."""
    module = SimulatedModule(DIO100, 4)
    module.set_mode(2, pulse=True, hold_s=0.5)
    done = scan(VirtualPanel(LineProtocol.MODBUS_RTU, 9600, [module]), FAST)
    assert [one.settings for one in done.findings.found] == [module.settings]


def test_a_scan_ends_when_all_that_are_expected_were_found() -> None:
    """A scan with `expect` ends with the third module, at the first baud rate."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, twelve_modules())
    done = scan(panel, ALL, expect=3)
    assert [one.address for one in done.findings.found] == [1, 3, 5]
    assert panel.opened == [9600]
    assert not any(frame.startswith(b"#06") for _, frame in panel.sent)


def test_the_port_is_opened_once_for_each_baud_rate() -> None:
    """Opening takes time, and toggles control lines of some adapters."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, [])
    scan(panel, FAST)
    assert panel.opened == list(BAUDS)


def test_an_empty_line_takes_what_was_foretold() -> None:
    """The time left comes down to nothing, step by step."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, [])
    steps: list[float] = []

    def tell(event: ScanStep | Finding) -> None:
        assert isinstance(event, ScanStep)
        steps.append(event.left_s)

    done = Scan(FAST, panel.open, tell, panel.time.clock, panel.time.sleep)
    done.run()
    assert steps[0] == pytest.approx(FAST.total_s)
    assert steps == sorted(steps, reverse=True)
    assert 0 < steps[-1] < 0.1
    assert done.took_s == pytest.approx(FAST.total_s, rel=0.02)


# --- two modules at one address ---


def clash_on(port: VirtualPort, protocols: Collection[LineProtocol]) -> Scan:
    """Scans stations 6 to 8 on a port."""
    survey = survey_of([9600], protocols, [6, 7, 8], QUICK)
    done = Scan(survey, lambda _: port, lambda _: None, port.time.clock, port.time.sleep)
    done.run()
    return done


def three_modules(model_of_two: tuple[SimulatedModule, SimulatedModule]) -> list[SimulatedModule]:
    """Two at station 7, and a good one at station 8."""
    return [*model_of_two, SimulatedModule(DIO100, 8)]


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_two_models_at_one_address_are_a_clash(protocol: LineProtocol) -> None:
    """One answers, the other refuses, at once: what comes is garbled, and named as such."""
    modules = three_modules((SimulatedModule(DIO100, 7), SimulatedModule(DO100, 7)))
    done = clash_on(collision(VirtualTime(), *modules), [protocol])
    assert [(one.address, one.protocol) for one in done.findings.clashes] == [(7, protocol)]
    assert [one.address for one in done.findings.found] == [8]
    assert done.findings.clashes[0].evidence


@pytest.mark.parametrize("protocol", [LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII])
def test_two_of_one_model_are_a_clash_where_a_checksum_shows_it(protocol: LineProtocol) -> None:
    """Two modules of one model with different inputs are a clash, because checksums fail."""
    first, second = SimulatedModule(DIO100, 7), SimulatedModule(DIO100, 7)
    first.set_input(1, value=True)
    first.set_output(2, value=True)
    second.set_input(12, value=True)
    second.set_mode(3, pulse=True)
    modules = three_modules((first, second))
    done = clash_on(collision(VirtualTime(), *modules), [protocol])
    assert [one.address for one in done.findings.clashes] == [7]
    assert [one.address for one in done.findings.found] == [8]


def test_two_that_answer_one_after_the_other_are_a_clash() -> None:
    """The first reply is whole; what comes behind it is the other's."""
    panel = VirtualPanel(
        LineProtocol.WISCO, 9600, [SimulatedModule(DIO100, 7), SimulatedModule(DIO100, 8)]
    )
    panel.modules[107] = SimulatedModule(DO100, 7)
    done = scan(panel, FAST)
    assert [one.address for one in done.findings.clashes] == [7]
    assert [one.address for one in done.findings.found] == [8]
    assert any("more came behind a reply" in text for text in done.findings.clashes[0].evidence)


def test_two_that_answer_alike_are_one() -> None:
    """Two modules with equal answers are found as one, as the documents say."""
    modules = three_modules((SimulatedModule(DIO100, 7), SimulatedModule(DIO100, 7)))
    done = clash_on(collision(VirtualTime(), *modules), QUICK_PROTOCOLS[:1])
    assert [one.address for one in done.findings.found] == [7, 8]
    assert done.findings.clashes == []


def test_a_clash_is_not_asked_again() -> None:
    """A clash is not asked again, neither in the next round nor in the other text protocol."""
    port = collision(VirtualTime(), SimulatedModule(DIO100, 7), SimulatedModule(DO100, 7))
    text = [LineProtocol.WISCO, LineProtocol.MODBUS_ASCII]
    survey = survey_of([9600], text, [7], THOROUGH)
    done = Scan(survey, lambda _: port, lambda _: None, port.time.clock, port.time.sleep)
    done.run()
    assert len(done.findings.clashes) == 1


# --- noise ---


def test_bytes_that_come_whoever_is_asked_are_noise_and_no_clash() -> None:
    """A babbling line has no modules, and no address of it is blamed."""
    time = VirtualTime()
    port = VirtualPort(time, lambda _: [(0.01 * n, b"\x5a\xa5") for n in range(1, 80)])
    survey = survey_of([9600], QUICK_PROTOCOLS, range(4), QUICK)
    done = Scan(survey, lambda _: port, lambda _: None, time.clock, time.sleep)
    done.run()
    assert (done.findings.found, done.findings.clashes) == ([], [])
    assert "5a a5" in done.findings.noises[0].evidence


def test_what_answers_once_is_noise() -> None:
    """A late reply of another station looks like this station's, once."""
    time = VirtualTime()
    replies = [b"DI>0000\r"]
    port = VirtualPort(time, lambda _: [(0.02, replies.pop())] if replies else [])
    survey = survey_of([9600], [LineProtocol.WISCO], [3], QUICK)
    told: list[ScanStep | Finding] = []
    done = Scan(survey, lambda _: port, told.append, time.clock, time.sleep)
    done.run()
    assert (done.findings.found, done.findings.clashes) == ([], [])
    assert [noise.address for noise in done.findings.noises] == [3]
    assert [event for event in told if isinstance(event, Noise)] == done.findings.noises


def test_noise_is_kept_within_bounds() -> None:
    """The number of kept noises is limited, however long the scan is."""
    time = VirtualTime()
    port = VirtualPort(time, lambda _: [(0.2, b"\x00")])
    done = Scan(TWO_RATES, lambda _: port, lambda _: None, time.clock, time.sleep)
    done.run()
    assert len(done.findings.noises) == 100


def test_what_was_found_is_kept_when_the_port_goes() -> None:
    """The command tells it, and then what happened."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, twelve_modules())

    def open_once(baud: int) -> Port:
        if panel.opened:
            raise PortError("it is gone")
        return panel.open(baud)

    done = Scan(FAST, open_once, lambda _: None, panel.time.clock, panel.time.sleep)
    with pytest.raises(PortError):
        done.run()
    assert is_all_of_twelve(done)
    assert done.took_s > 0


def test_a_finding_is_told_when_it_is_made() -> None:
    """The bar counts them."""
    panel = VirtualPanel(LineProtocol.WISCO, 9600, twelve_modules())
    told: list[ScanStep | Finding] = []
    Scan(FAST, panel.open, told.append, panel.time.clock, panel.time.sleep).run(expect=2)
    assert sum(isinstance(event, Found) for event in told) == 2
    assert not any(isinstance(event, Clash) for event in told)
