"""Writes a configuration of the modules that were found: complete, and meant to be edited."""

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence

from bridge.commission.dip import switches_for
from bridge.commission.findings import Clash, Found, dip_text
from bridge.model import HOLD_DS, OutputSettings, channels_of

_LINE = "main"
_PLAIN = re.compile(r"[/a-z][\w./:-]*", re.ASCII)  # what needs no quotes in YAML


def configuration(port: str, found: Sequence[Found], clashes: Sequence[Clash]) -> str:
    """Return the text of a configuration file. `found` is not empty."""
    baud, protocol = main_setting(found)
    on_line = [one for one in found if (one.baud, one.protocol) == (baud, protocol)]
    others = [one for one in found if one not in on_line]
    lines = [
        "# What answered on this line. Change ids and names before anything uses them: topics are",
        "# made of ids. Every key is in config.example.yaml; `wisco2mqtt check` looks at it all.",
        "",
        "mqtt:",
        "  host: localhost   # your broker",
        "  # username: wisco",
        "  # password: !file /etc/wisco2mqtt/mqtt-password",
        "",
        "lines:",
        f"  - id: {_LINE}",
        *_port(port),
        f"    baud: {baud}",
        f"    protocol: {protocol}",
        "    stations:",
    ]
    for one in sorted(on_line, key=lambda one: one.station):
        lines += _station(one)
    for other in others:
        lines += _left_out(other, on_line[0])
    for clash in clashes:
        lines += [
            f"    # Address {clash.station} answers garbled: two modules with one address, as a",
            "    # rule. Give one of them another, and scan again.",
        ]
    return "\n".join(lines) + "\n"


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


def _station(one: Found) -> Iterator[str]:
    yield f"      - address: {one.station}   # DIP {dip_text(one.switches)}"
    yield f"        model: {one.model.name}"
    yield f"        id: {_LINE}_{one.station:02}"
    yield f"        name: {one.model.name} {one.station}"
    if one.settings is not None and one.settings.pulse:
        yield "        outputs:   # as the module has them"
        yield from _pulses(one.settings)


def _pulses(settings: OutputSettings) -> Iterator[str]:
    for output in channels_of(settings.pulse):
        hold_ds = settings.hold_ds[output - 1]
        hold = f", hold: {hold_ds / 10:.1f}s" if hold_ds in HOLD_DS else ""
        yield f"          {output}: {{mode: pulse{hold}}}"


def _left_out(one: Found, line: Found) -> Iterator[str]:
    yield f"    # Left out: a {one.model.name} at address {one.station} answers"
    yield f"    # {one.protocol} at {one.baud} baud. A line has one of each; to bring it here set"
    wanted = switches_for(one.station, line.baud, line.protocol)
    yield f"    # its DIP switches to {dip_text(wanted)}"
