from dataclasses import replace

import pytest
from support.house import make_config

from bridge.config.advice import advice_on

BY_ID = "/dev/serial/by-id/usb-FTDI_A1"


def advice(*ports: str) -> list[str]:
    """The advice on lines with these ports."""
    config = make_config()
    lines = tuple(
        replace(config.lines[0], id=f"line{n}", port=port) for n, port in enumerate(ports)
    )
    return list(advice_on(replace(config, lines=lines)))


def test_numbered_adapters_on_several_lines_are_advised_against() -> None:
    """One line each: which line, why, and what to write instead (docs/failures.md A13)."""
    first, second = advice("/dev/ttyUSB0", "/dev/ttyACM13")
    assert first.startswith("line line0: /dev/ttyUSB0 may be another adapter")
    assert second.startswith("line line1: /dev/ttyACM13 may be another adapter")
    assert "/dev/serial/by-id" in first
    assert "\n" not in first


def test_only_the_numbered_one_is_named() -> None:
    """Only /dev/ttyUSBn gets advice: it may become the adapter of another line."""
    (only,) = advice(BY_ID, "/dev/ttyUSB1")
    assert only.startswith("line line1:")


@pytest.mark.parametrize(
    "ports",
    [
        ("/dev/ttyUSB0",),
        ("/dev/ttyUSB0", "tcp://192.0.2.5:4196"),
        (BY_ID, "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0"),
        ("/dev/ttyS0", "/dev/ttyAMA0"),
    ],
)
def test_what_cannot_be_mistaken_needs_no_advice(ports: tuple[str, ...]) -> None:
    """One adapter alone, gateways, lasting paths, ports that are soldered on."""
    assert advice(*ports) == []
