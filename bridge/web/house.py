"""The documents that say what there is: lines, modules, channels, and how the switches stand."""

from typing import Any

from bridge.commission.dip import switches_for
from bridge.config.schema import Config, CoverConfig, LineConfig, OutputConfig, StationConfig


def house(config: Config) -> dict[str, Any]:
    """Return everything that is configured, without broker and keys."""
    return {"lines": [_line(line) for line in config.lines]}


def _line(line: LineConfig) -> dict[str, Any]:
    return {
        "id": line.id,
        "port": line.port,
        "baud": line.baud,
        "protocol": line.protocol,
        "stations": [_station(line, station) for station in line.stations],
    }


def _station(line: LineConfig, station: StationConfig) -> dict[str, Any]:
    return {
        "id": station.id,
        "name": station.name,
        "area": station.area,
        "model": station.model.name,
        "address": station.address,
        "dip": switches_for(station.address, line.baud, line.protocol),
        "inputs": [{"n": i.channel, "name": i.name} for i in station.inputs],
        "outputs": [_output(output, station) for output in station.outputs],
        "covers": [_cover(cover) for cover in station.covers],
    }


def _output(output: OutputConfig, station: StationConfig) -> dict[str, Any]:
    is_covers = bool(station.cover_outputs >> (output.channel - 1) & 1)
    return {
        "n": output.channel,
        "name": output.name,
        "mode": output.mode,
        "hold": output.hold_s,
        "read_only": output.read_only,
        "cover": is_covers,
    }


def _cover(cover: CoverConfig) -> dict[str, Any]:
    return {"id": cover.id, "name": cover.name, "open": cover.open, "close": cover.close}
