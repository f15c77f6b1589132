"""What `wisco2mqtt scan` prints: a line a module for people, one object for programs."""

import json
import sys
from typing import Any

from bridge.cli.terminal import print_table
from bridge.commission.findings import Clash, Found, Noise, dip_text
from bridge.commission.proposal import main_setting
from bridge.commission.scan import Scan

_HEADER = ("address", "model", "baud", "protocol", "DIP switches", "")
_NOISES_SHOWN = 3


def report(port: str, scan: Scan, *, as_json: bool) -> None:
    """Prints findings to stdout, and remarks on them to stderr."""
    if as_json:
        print(json.dumps(as_document(port, scan), ensure_ascii=False))
        return
    rows = [*map(_found_row, scan.found), *map(_clash_row, scan.clashes)]
    if rows:
        print_table(_HEADER, sorted(rows, key=lambda row: int(row[0])))
    for text in _remarks(scan):
        print(text, file=sys.stderr)


def _found_row(one: Found) -> tuple[str, ...]:
    notes = [f"answers {other} too" for other in one.protocols[1:]]
    if one.damaged:
        notes.append(f"{one.damaged} of {one.asked} replies damaged")
    return (
        f"{one.station}",
        one.model.name,
        f"{one.baud}",
        one.protocol,
        dip_text(one.switches),
        "; ".join(notes),
    )


def _clash_row(one: Clash) -> tuple[str, ...]:
    words = f"two modules with this address? {one.damaged} of {one.asked} replies garbled: "
    return f"{one.station}", "clash", f"{one.baud}", one.protocol, "", words + one.evidence[0]


def _remarks(scan: Scan) -> list[str]:
    found = _count_words(len(scan.found), "module")
    least = f"bytes, silences and time-outs take {scan.least_s:.1f} s of it"
    texts = [f"{found} found in {scan.took_s:.1f} s; {least}"]
    if scan.found:
        baud, protocol = main_setting(scan.found)
        if strangers := [o for o in scan.found if (o.baud, o.protocol) != (baud, protocol)]:
            texts.append(
                f"{_count_words(len(strangers), 'module')} of them not at {baud} baud in "
                f"{protocol}: a line has one of each"
            )
    elif not scan.clashes:
        texts.append(
            "nobody answered: is the panel powered, are A and B the right way round? "
            "--thorough tries longer"
        )
    texts += map(_noise_words, scan.noises[:_NOISES_SHOWN])
    if (more := len(scan.noises) - _NOISES_SHOWN) > 0:
        texts.append(f"noise {_count_words(more, 'time')} more")
    return texts


def _noise_words(noise: Noise) -> str:
    who = "nobody" if noise.station is None else f"station {noise.station}"
    return (
        f"noise at {noise.baud} baud in {noise.protocol}, {who} asked: {noise.evidence} "
        "(another master? termination, biasing, a late gateway?)"
    )


def _count_words(count: int, word: str) -> str:
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"


def as_document(port: str, scan: Scan) -> dict[str, Any]:
    """What programs get."""
    return {
        "port": port,
        "found": [
            {
                "address": one.station,
                "model": one.model.name,
                "baud": one.baud,
                "protocol": one.protocol,
                "answers": list(one.protocols),
                "dip": dip_text(one.switches),
                "damaged": one.damaged,
            }
            for one in sorted(scan.found, key=lambda one: one.station)
        ],
        "clashes": [
            {
                "address": one.station,
                "baud": one.baud,
                "protocol": one.protocol,
                "evidence": list(one.evidence),
            }
            for one in scan.clashes
        ],
        "noise": [
            {
                "asked": one.station,
                "baud": one.baud,
                "protocol": one.protocol,
                "evidence": one.evidence,
            }
            for one in scan.noises
        ],
        "seconds": round(scan.took_s, 3),
        "least_seconds": round(scan.least_s, 3),
    }
