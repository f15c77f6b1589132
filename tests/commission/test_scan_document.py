"""Findings as JSON and back: the bridge tells them, and `scan --line` shows them."""

import json

import pytest

from bridge.commission.findings import Clash, Findings, Found, Noise
from bridge.commission.scan_document import findings_document, read_findings
from bridge.model import DIO100, LineProtocol


def findings() -> Findings:
    """One of each."""
    made = Findings()
    text = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
    made.add(Found(13, DIO100, 9600, text, None, damaged=1, asked=6))
    made.add(Clash(3, 9600, LineProtocol.WISCO, ("DO>0", "?"), damaged=7, asked=8))
    made.add(Noise(None, 9600, LineProtocol.WISCO, "ff 00"))
    made.add(Noise(7, 9600, LineProtocol.MODBUS_RTU, "late"))
    return made


def test_all_of_it_comes_back() -> None:
    """Findings survive the way to JSON and back, except for settings."""
    document = json.loads(json.dumps(findings_document(findings())))
    again = read_findings(document)
    assert (again.found, again.clashes, again.noises) == (
        findings().found,
        findings().clashes,
        findings().noises,
    )


@pytest.mark.parametrize("change", [{"found": [{}]}, {"found": 3}, {"noise": [{"asked": "x"}]}])
def test_anything_else_is_refused(change: dict[str, object]) -> None:
    """A stranger may write to any topic."""
    with pytest.raises(ValueError, match="no findings"):
        read_findings({**findings_document(findings()), **change})
    with pytest.raises(ValueError, match="no findings"):
        read_findings({})
