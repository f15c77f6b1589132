"""Writes a configuration of the modules that were found: complete, and meant to be edited."""

import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bridge.commission.dip import switches_for
from bridge.commission.findings import Clash, Found, dip_text
from bridge.config.schema import CURRENT_VERSION
from bridge.model import HOLD_DS, OutputSettings, channels_of

_LINE = "main"
Names = Mapping[str, Any]  # of a module: id, name, and those of its inputs and outputs
_PLAIN = re.compile(r"[/a-z][\w./:-]*", re.ASCII)  # what needs no quotes in YAML


def configuration(
    port: str, found: Sequence[Found], clashes: Sequence[Clash], timings: Sequence[str] = ()
) -> str:
    """Return the text of a configuration file. `found` is not empty; `timings` are of the line."""
    lines = [
        "# What answered on this line. Change ids and names before anything uses them: topics are",
        "# made of ids. Every key is in config.example.yaml; `wisco2mqtt check` looks at it all.",
        "",
        f"config_version: {CURRENT_VERSION}",
        "",
        "mqtt:",
        "  host: localhost   # your broker",
        "  # username: wisco",
        "  # From /etc/wisco2mqtt/mqtt-password, for the service, and for you with sudo:",
        "  # password: !file /run/credentials/wisco2mqtt.service/mqtt-password",
        "",
        "lines:",
        *line_section(port, found, clashes, timings),
    ]
    return "\n".join(lines) + "\n"


def line_section(
    port: str,
    found: Sequence[Found],
    clashes: Sequence[Clash],
    timings: Sequence[str] = (),
    *,
    names: Mapping[int, Names] | None = None,
    line_id: str = _LINE,
) -> list[str]:
    """Return one item of `lines`, line by line; `names` are those of modules, by address."""
    baud, protocol = main_setting(found)
    on_line = [one for one in found if (one.baud, one.protocol) == (baud, protocol)]
    others = [one for one in found if one not in on_line]
    lines = [
        f"  - id: {line_id}",
        *_port(port),
        f"    baud: {baud}",
        f"    protocol: {protocol}",
        *(f"    {timing}" for timing in timings),
        "    stations:",
    ]
    for one in sorted(on_line, key=lambda one: one.address):
        lines += _station(one, line_id, (names or {}).get(one.address, {}))
    for other in others:
        lines += _left_out(other, on_line[0])
    for clash in clashes:
        lines += [
            f"    # Address {clash.address} answers garbled: two modules with one address, as a",
            "    # rule. Give one of them another, and scan again.",
        ]
    return lines


def main_setting(found: Sequence[Found]) -> tuple[int, str]:
    """Return baud rate and protocol of most modules: a line has one of each."""
    ((setting, _),) = Counter((one.baud, one.protocol) for one in found).most_common(1)
    return setting


def _port(port: str) -> Iterator[str]:
    if "://" in port:
        yield f"    port: {_quoted(port)}"
        return
    if os.path.basename(port).startswith(("ttyUSB", "ttyACM")):  # noqa: PTH119  # a port is text
        yield "    # ls -l /dev/serial/by-id/ tells a name that stays when adapters come and go."
    # Links are not followed: a name below by-id is the better one.
    yield f"    port: {_quoted(os.path.abspath(port))}"  # noqa: PTH100  # as above


def _quoted(text: str) -> str:
    return text if _PLAIN.fullmatch(text) else "'" + text.replace("'", "''") + "'"


def _station(one: Found, line_id: str, names: Names) -> Iterator[str]:
    yield f"      - address: {one.address}   # DIP {dip_text(one.switches)}"
    yield f"        model: {one.model.name}"
    yield f"        id: {names.get('id') or f'{line_id}_{one.address:02}'}"
    name = names.get("name")
    yield f"        name: {_text(name) if name else f'{one.model.name} {one.address}'}"
    if inputs := _named(names, "inputs"):
        yield "        inputs:"
        yield from (f"          {n}: {{{', '.join(parts)}}}" for n, parts in inputs.items())
    outputs = _named(names, "outputs")
    pulses = {} if one.settings is None else _pulses(one.settings)
    for output, parts in pulses.items():
        outputs.setdefault(output, []).extend(parts)
    if outputs:
        yield "        outputs:" + ("   # as the module has them" if pulses else "")
        yield from (f"          {n}: {{{', '.join(outputs[n])}}}" for n in sorted(outputs))


def _named(names: Names, way: str) -> dict[int, list[str]]:
    """Return what the configuration says of channels that were given a name."""
    given = {int(n): name for n, name in names.get(way, {}).items() if name}
    return {n: [f"name: {_text(given[n])}"] for n in sorted(given)}


def _pulses(settings: OutputSettings) -> dict[int, list[str]]:
    found = {}
    for output in channels_of(settings.pulse):
        hold_ds = settings.hold_ds[output - 1]
        hold = [f"hold: {hold_ds / 10:.1f}s"] if hold_ds in HOLD_DS else []
        found[output] = ["mode: pulse", *hold]
    return found


def _text(text: str) -> str:
    """Return a name in double quotes: JSON text is YAML text."""
    return json.dumps(text, ensure_ascii=False)


def _left_out(one: Found, line: Found) -> Iterator[str]:
    yield f"    # Left out: a {one.model.name} at address {one.address} answers"
    yield f"    # {one.protocol} at {one.baud} baud. A line has one of each; to bring it here set"
    wanted = switches_for(one.address, line.baud, line.protocol)
    yield f"    # its DIP switches to {dip_text(wanted)}"
