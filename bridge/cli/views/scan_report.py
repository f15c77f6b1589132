"""The output of `scan`: one line for each module for people, one object for programs."""

import json
import sys
from dataclasses import dataclass

from bridge.cli.frame.terminal import print_table
from bridge.commission.findings import Clash, Findings, Found, Noise, dip_text
from bridge.commission.proposal import main_setting
from bridge.commission.scan_document import findings_document

_HEADER = ("address", "model", "baud", "protocol", "DIP switches", "")
_NOISES_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Spent:
    """The time of a scan.

    Attributes:
        least_s: The part that wire and time-outs need; None: the line did other work too.
    """

    took_s: float
    least_s: float | None = None

    @property
    def words(self) -> str:
        """Return the time in words, for people."""
        took = f"{self.took_s:.1f} s"
        if self.least_s is None:
            return f"{took}, between polls"
        return f"{took}; bytes, silences and time-outs take {self.least_s:.1f} s of it"

    @property
    def document(self) -> dict[str, float]:
        """Return the time for programs."""
        document = {"seconds": round(self.took_s, 3)}
        if self.least_s is not None:
            document["least_seconds"] = round(self.least_s, 3)
        return document


def report(port: str, findings: Findings, spent: Spent, *, as_json: bool) -> None:
    """Print findings to stdout, and remarks to stderr."""
    if as_json:
        document = {"port": port, **findings_document(findings), **spent.document}
        print(json.dumps(document, ensure_ascii=False))
        return
    rows = [*map(_found_row, findings.found), *map(_clash_row, findings.clashes)]
    if rows:
        print_table(_HEADER, sorted(rows, key=lambda row: int(row[0])))
    for text in _remarks(findings, spent):
        print(text, file=sys.stderr)


def _found_row(one: Found) -> tuple[str, ...]:
    notes = [f"answers {other} too" for other in one.protocols[1:]]
    if one.damaged:
        notes.append(f"{one.damaged} of {one.asked} replies damaged")
    return (
        f"{one.address}",
        one.model.name,
        f"{one.baud}",
        one.protocol,
        dip_text(one.switches),
        "; ".join(notes),
    )


def _clash_row(one: Clash) -> tuple[str, ...]:
    words = f"two modules with this address? {one.damaged} of {one.asked} replies garbled: "
    return f"{one.address}", "clash", f"{one.baud}", one.protocol, "", words + one.evidence[0]


def _remarks(findings: Findings, spent: Spent) -> list[str]:
    texts = [f"{_count_words(len(findings.found), 'module')} found in {spent.words}"]
    if findings.found:
        baud, protocol = main_setting(findings.found)
        if strangers := [o for o in findings.found if (o.baud, o.protocol) != (baud, protocol)]:
            texts.append(
                f"{_count_words(len(strangers), 'module')} of them not at {baud} baud in "
                f"{protocol}: a line has one of each"
            )
    elif not findings.clashes:
        texts.append(
            "no module answered: is the panel powered, are A and B the right way round? "
            "--thorough tries longer"
        )
    texts += map(_noise_words, findings.noises[:_NOISES_SHOWN])
    if (more := len(findings.noises) - _NOISES_SHOWN) > 0:
        texts.append(f"noise {_count_words(more, 'time')} more")
    return texts


def _noise_words(noise: Noise) -> str:
    who = "no module" if noise.address is None else f"station {noise.address}"
    return (
        f"noise at {noise.baud} baud in {noise.protocol}, {who} asked: {noise.evidence} "
        "(another master? termination, biasing, a late gateway?)"
    )


def _count_words(count: int, word: str) -> str:
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"
