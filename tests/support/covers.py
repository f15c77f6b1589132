"""A cover in a configuration that has none."""

from dataclasses import replace

from bridge.config.schema import Config, CoverConfig, StationConfig

SHUTTER = CoverConfig("shutter", "Shutter", 1, 2, 20.0, 18.0, device_class="shutter")


def cover_station(station: StationConfig) -> StationConfig:
    """The same station with `SHUTTER` at its outputs 1 and 2."""
    return replace(station, covers=(SHUTTER,), interlock=(SHUTTER.outputs,))


def with_cover(config: Config) -> Config:
    """The same configuration with `SHUTTER` at the first station of the first line."""
    first, *lines = config.lines
    station, *stations = first.stations
    line = replace(first, stations=(cover_station(station), *stations))
    return replace(config, lines=(line, *lines))
