"""A small house: a configuration with an output of every kind that Home Assistant knows."""

from decimal import Decimal
from pathlib import Path

from bridge.config.schema import (
    Config,
    CountConfig,
    GestureConfig,
    HomeAssistantConfig,
    InputConfig,
    LineConfig,
    MqttConfig,
    OutputConfig,
    StationConfig,
)
from bridge.model import DIO100, DO100, LineProtocol

GARAGE = StationConfig(
    address=1,
    model=DIO100,
    id="garage",
    name="Garage ä",
    area="Yard",
    inputs=(
        InputConfig(1, name="Door", device_class="door"),
        InputConfig(3),
        InputConfig(5, name="Bell", gestures=GestureConfig()),
        InputConfig(6, name="Meter", count=CountConfig("m³", Decimal("0.01"), "water")),
    ),
    outputs=(
        OutputConfig(1, name="Lamp", kind="light"),
        OutputConfig(2, name="Gate", mode="pulse", hold_s=0.5),
        OutputConfig(3, read_only=True),
        OutputConfig(4),
        OutputConfig(5, kind="valve"),
        OutputConfig(6, kind="lock"),
        OutputConfig(7, kind="siren"),
        OutputConfig(8, kind="fan", mode="latch"),
    ),
)
CELLAR = StationConfig(
    address=2,
    model=DO100,
    id="main_02",
    name="main_02",
    inputs=(),
    outputs=(OutputConfig(16, mode="pulse", read_only=True),),
)


def make_config(
    discovery: str = "device",
    *,
    base: str = "wisco",
    prefix: str = "homeassistant",
    stations: tuple[StationConfig, ...] = (GARAGE, CELLAR),
    configuration_url: str | None = None,
) -> Config:
    """Makes a configuration of one line."""
    return Config(
        mqtt=MqttConfig("localhost", 1883, base, "wisco2mqtt-test", "auto"),
        homeassistant=HomeAssistantConfig(discovery, prefix, f"{prefix}/status", configuration_url),
        state_dir=Path("/nonexistent"),
        lines=(LineConfig("main", "/dev/null", 9600, LineProtocol.WISCO, stations),),
    )
