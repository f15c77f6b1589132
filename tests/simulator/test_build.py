"""A configuration becomes modules that are as it declares."""

from dataclasses import replace
from pathlib import Path

import pytest

from bridge.config.schema import InputConfig, LineConfig, OutputConfig, StationConfig
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import PtyEndpoint, TcpEndpoint
from bridge.simulator.build import build_line, build_module, endpoint_for

STATION = StationConfig(
    address=7,
    model=DIO100,
    id="garage",
    name="Garage",
    inputs=(InputConfig(1),),
    outputs=(
        OutputConfig(1),
        OutputConfig(2, mode="pulse", hold_s=0.5),
        OutputConfig(3, mode="pulse"),
        OutputConfig(4, mode="latch", hold_s=25.5),
    ),
)
LINE = LineConfig(
    id="main",
    port="tcp://127.0.0.1:4196",
    baud=19200,
    protocol=LineProtocol.MODBUS_RTU,
    stations=(STATION, replace(STATION, address=8, model=DO100, outputs=())),
)


def test_declared_modes_and_hold_times() -> None:
    """A module has the modes and hold times that its owner declares, else the factory's."""
    settings = build_module(STATION).settings
    assert settings.pulse == 0b110
    assert settings.hold_ds == (10, 5, 10, 255, 10, 10, 10, 10)


def test_line_as_configured() -> None:
    """Name, protocol, baud rate and stations are those of the configuration."""
    line = build_line(LINE, endpoint=TcpEndpoint())
    assert (line.name, line.protocol, line.baud) == ("main", LineProtocol.MODBUS_RTU, 19200)
    assert {address: module.model for address, module in line.modules.items()} == {
        7: DIO100,
        8: DO100,
    }


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_loopback_ports_are_listened_on(host: str) -> None:
    """A TCP port of this machine is where the line appears."""
    endpoint = endpoint_for(replace(LINE, port=f"tcp://{host}:4196"), None)
    assert isinstance(endpoint, TcpEndpoint)
    assert endpoint.port == "tcp://127.0.0.1:4196"


@pytest.mark.parametrize(
    "port", ["/dev/ttyUSB0", "tcp://10.0.0.5:4196", "rfc2217://127.0.0.1:4196"]
)
def test_other_ports_become_ptys(port: str, tmp_path: Path) -> None:
    """A port that cannot be opened on this machine becomes a pty with the name of the line."""
    endpoint = endpoint_for(replace(LINE, port=port), tmp_path)
    assert isinstance(endpoint, PtyEndpoint)
    endpoint.open()
    assert endpoint.port == str(tmp_path / "main")
    assert endpoint.baud() == 19200
    endpoint.close()
