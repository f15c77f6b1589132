"""A cover in a configuration that has none."""

from dataclasses import replace

from bridge.config.schema import Config, CoverConfig, StationConfig

SHUTTER = CoverConfig("shutter", "Shutter", 1, 2, 20.0, 18.0, device_class="shutter")


def cover_station(config: StationConfig) -> StationConfig:
    """The same station with `SHUTTER` at its outputs 1 and 2."""
    return replace(config, covers=(SHUTTER,), interlock=(SHUTTER.outputs,))


def with_cover(config: Config) -> Config:
    """The same configuration with `SHUTTER` at the first station of the first line."""
    first, *lines = config.lines
    station_config, *stations = first.stations
    line = replace(first, stations=(cover_station(station_config), *stations))
    return replace(config, lines=(line, *lines))
