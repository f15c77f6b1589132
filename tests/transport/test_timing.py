import time
from dataclasses import replace

import pytest

from bridge.config.schema import LineConfig
from bridge.model import LineProtocol
from bridge.transport.timing import LineTiming, rtu_silence_s, sleep_exactly


def timing(
    protocol: LineProtocol,
    baud: int = 9600,
    *,
    turnaround_s: float = 0.002,
    timeout_s: float | None = None,
    silence_s: float | None = None,
) -> LineTiming:
    """The timing of a line so configured."""
    line = LineConfig(
        "main",
        "/dev/null",
        baud,
        protocol,
        stations=(),
        turnaround_s=turnaround_s,
        timeout_s=timeout_s,
        silence_s=silence_s,
    )
    return LineTiming.from_config(line)


@pytest.mark.parametrize(
    ("protocol", "request_chars", "reply_chars", "floor_ms"),
    [(LineProtocol.MODBUS_RTU, 8, 7, 8.1), (LineProtocol.WISCO, 8, 8, 4.8)],
)
def test_floor_of_the_worked_examples(
    protocol: LineProtocol, request_chars: int, reply_chars: int, floor_ms: float
) -> None:
    """DIO100 inputs at 57600 baud cost what docs/protocol.md section 5 works out."""
    floor_s = timing(protocol, 57600).floor_s(request_chars, reply_chars)
    assert round(1000 * floor_s, 1) == floor_ms


@pytest.mark.parametrize(
    ("baud", "silence_ms"), [(4800, 7.292), (9600, 3.646), (19200, 1.823), (57600, 1.75)]
)
def test_rtu_silence(baud: int, silence_ms: float) -> None:
    """RTU frames are 3.5 characters apart, and 1.75 ms above 19200 baud."""
    assert 1000 * rtu_silence_s(baud) == pytest.approx(silence_ms, abs=0.001)


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_ASCII])
def test_frames_with_terminators_need_no_silence(protocol: LineProtocol) -> None:
    """Wisco and Modbus ASCII frames follow each other at once."""
    assert timing(protocol).silence_s == 0
    assert timing(protocol).end_silence_s == 0


def test_timeout_is_worked_out() -> None:
    """Left to us, the time-out is wire time, the module's waiting, turnaround and 100 ms."""
    rtu = timing(LineProtocol.MODBUS_RTU, 9600, turnaround_s=0.005)
    wire_s = (8 + 7) / 960
    assert rtu.timeout_s(8, 7) == pytest.approx(wire_s + 3.5 / 960 + 0.005 + 0.1)


def test_configured_timeout_holds() -> None:
    """A configured time-out holds for every exchange, long or short."""
    fixed = timing(LineProtocol.WISCO, timeout_s=0.75)
    assert fixed.timeout_s(8, 8) == fixed.timeout_s(16, 1008) == 0.75


def test_configured_silence_is_what_we_keep() -> None:
    """A configured silence replaces ours, not the one that a module waits for."""
    rtu = timing(LineProtocol.MODBUS_RTU, 9600, silence_s=0.02)
    assert rtu.silence_s == 0.02
    assert rtu.end_silence_s == pytest.approx(3.5 / 960)
    assert rtu.floor_s(8, 7) == pytest.approx(15 / 960 + 3.5 / 960 + 0.02 + 0.002)


def test_the_margin_of_a_time_out_may_be_another() -> None:
    """A scan waits less for stations that are not there, and a configured time-out stays."""
    timing = LineTiming(9600, 0.005, 0.0, 0.0)
    brisk = replace(timing, margin_s=0.03)
    assert timing.timeout_s(8, 8) - brisk.timeout_s(8, 8) == pytest.approx(0.07)
    assert replace(brisk, fixed_timeout_s=0.5).timeout_s(8, 8) == 0.5


@pytest.mark.parametrize("seconds", [0.0, 0.00005, 0.00175])
def test_a_silence_is_never_cut_short(seconds: float) -> None:
    """A silence of any length is never shortened."""
    for _ in range(50):
        begun = time.monotonic()
        sleep_exactly(seconds)
        assert time.monotonic() - begun >= seconds
