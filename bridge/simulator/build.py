"""Builds a simulated line from a configured line: the modules have the declared modes."""

from pathlib import Path
from urllib.parse import urlsplit

from bridge.config.schema import LineConfig, OutputConfig, StationConfig
from bridge.simulator.dialect import Tongue
from bridge.simulator.endpoint import Endpoint
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.tcp import HOST, TcpEndpoint

LOOPBACK = (HOST, "localhost")


def build_line(
    config: LineConfig,
    *,
    endpoint: Endpoint,
    paced: bool = True,
    listener: Listener | None = None,
    tongue: Tongue | None = None,
) -> SimulatedLine:
    """Build the modules of a line, with the declared modes and hold times."""
    modules = [build_module(station_config, listener) for station_config in config.stations]
    return SimulatedLine(
        config.protocol,
        config.baud,
        modules,
        paced=paced,
        turnaround_s=config.turnaround_s,
        endpoint=endpoint,
        tongue=tongue,
        name=config.id,
    )


def build_module(config: StationConfig, listener: Listener | None = None) -> SimulatedModule:
    """Build one module with the declared modes and hold times."""
    module = SimulatedModule(config.model, config.address, listener=listener)
    for output in config.outputs:
        _declare(module, output)
    return module


def _declare(module: SimulatedModule, output: OutputConfig) -> None:
    if output.hold_s is not None:
        module.set_mode(output.channel, pulse=output.mode == "pulse", hold_s=output.hold_s)
    elif output.mode is not None:
        module.set_mode(output.channel, pulse=output.mode == "pulse")


def endpoint_for(config: LineConfig, directory: Path | None) -> Endpoint:
    """Return the loopback port in the configuration, else a pty.

    The pty is linked as `directory`/LINE, if `directory` is given.
    """
    address = urlsplit(config.port)
    if address.scheme == "tcp" and address.hostname in LOOPBACK and address.port:
        return TcpEndpoint(address.port)
    return PtyEndpoint(directory / config.id if directory else None, baud=config.baud)
