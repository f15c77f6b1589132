"""Findings as JSON objects: written by `scan --json` and the daemon, and read back."""

from collections.abc import Mapping
from typing import Any

from bridge.commission.findings import Clash, Findings, Found, Noise, dip_text
from bridge.model import MODULE_TYPES, LineProtocol


def findings_document(findings: Findings) -> dict[str, Any]:
    """Return all findings: `found`, `clashes`, `noise`."""
    return {
        "found": [_found(one) for one in sorted(findings.found, key=lambda one: one.address)],
        "clashes": [_clash(one) for one in findings.clashes],
        "noise": [_noise(one) for one in findings.noises],
    }


def read_findings(document: Mapping[str, Any]) -> Findings:
    """Return the findings of a document; the settings of modules are not part of it.

    Raises:
        ValueError: It is not such a document.
    """
    findings = Findings()
    try:
        findings.found = [_read_found(one) for one in document["found"]]
        findings.clashes = [_read_clash(one) for one in document["clashes"]]
        findings.noises = [_read_noise(one) for one in document["noise"]]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"no findings of a scan: {error!r}") from error
    return findings


def _found(one: Found) -> dict[str, Any]:
    return {
        "address": one.address,
        "model": one.model.name,
        "baud": one.baud,
        "protocol": one.protocol,
        "answers": list(one.protocols),
        "dip": dip_text(one.switches),
        "damaged": one.damaged,
        "asked": one.asked,
    }


def _read_found(document: Mapping[str, Any]) -> Found:
    return Found(
        address=int(document["address"]),
        model=MODULE_TYPES[document["model"]],
        baud=int(document["baud"]),
        protocols=tuple(map(LineProtocol, document["answers"])),
        settings=None,
        damaged=int(document["damaged"]),
        asked=int(document["asked"]),
    )


def _clash(one: Clash) -> dict[str, Any]:
    return {
        "address": one.address,
        "baud": one.baud,
        "protocol": one.protocol,
        "evidence": list(one.evidence),
        "damaged": one.damaged,
        "asked": one.asked,
    }


def _read_clash(document: Mapping[str, Any]) -> Clash:
    return Clash(
        address=int(document["address"]),
        baud=int(document["baud"]),
        protocol=LineProtocol(document["protocol"]),
        evidence=tuple(map(str, document["evidence"])),
        damaged=int(document["damaged"]),
        asked=int(document["asked"]),
    )


def _noise(one: Noise) -> dict[str, Any]:
    return {
        "asked": one.address,
        "baud": one.baud,
        "protocol": one.protocol,
        "evidence": one.evidence,
    }


def _read_noise(document: Mapping[str, Any]) -> Noise:
    return Noise(
        address=None if document["asked"] is None else int(document["asked"]),
        baud=int(document["baud"]),
        protocol=LineProtocol(document["protocol"]),
        evidence=str(document["evidence"]),
    )
