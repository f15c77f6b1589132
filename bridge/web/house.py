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
        "stations": [_station(line, config) for config in line.stations],
    }


def _station(line: LineConfig, config: StationConfig) -> dict[str, Any]:
    return {
        "id": config.id,
        "name": config.name,
        "area": config.area,
        "model": config.model.name,
        "address": config.address,
        "dip": switches_for(config.address, line.baud, line.protocol),
        "inputs": [{"n": i.channel, "name": i.name} for i in config.inputs],
        "outputs": [_output(output, config) for output in config.outputs],
        "covers": [_cover(cover) for cover in config.covers],
    }


def _output(output: OutputConfig, config: StationConfig) -> dict[str, Any]:
    is_covers = bool(config.cover_outputs >> (output.channel - 1) & 1)
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
