"""What `wisco2mqtt verify` prints: a table in words for people, one object for programs."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from bridge import __version__
from bridge.cli.frame.terminal import print_table
from bridge.commission.verify.assumptions import ASSUMPTIONS

_HEADER = ("assumption", "of the modules", "found", "what was seen")
_KINDS = ("silent", "garbled", "late", "echo")


def print_document(document: Mapping[str, Any], *, as_json: bool) -> None:
    """Print to stdout what was measured."""
    if as_json:
        print(json.dumps({"version": __version__, **document}, ensure_ascii=False))
        return
    print_table(_HEADER, list(_rows(document)))
    for station in document["stations"]:
        print(_cable(station["name"], station["errors"]))
    if len(document["stations"]) > 1:
        print(_cable(f"line {document['line']}", document["errors"]))
    for setting in document["settings"]:
        mark = "" if setting["now"] == setting["value"] else f" (now {setting['now']})"
        print(f"{setting['name']}: {setting['value']}{mark}  # {setting['why']}")


def _rows(document: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each assumption and what was seen of it; modules that agree share one."""
    stations = document["stations"]
    for name in ASSUMPTIONS:
        seen: dict[tuple[str, str], list[str]] = {}
        for station in stations:
            for finding in station["findings"]:
                if finding["id"] == name:
                    key = (finding["word"], finding["seen"])
                    seen.setdefault(key, []).append(station["name"])
        for (word, what), names in seen.items():
            yield name, "all" if len(names) == len(stations) else ", ".join(names), word, what


def _cable(name: str, errors: Mapping[str, Any]) -> str:
    kinds = ", ".join(f"{errors[kind]} {kind}" for kind in _KINDS if errors[kind]) or "no errors"
    idle = f", {errors['idle_bytes']} bytes of noise while idle" if errors["idle_bytes"] else ""
    return (
        f"{name}: {kinds} in {errors['asked']} exchanges{idle}; "
        f"at most {errors['rate_at_most']:.2%} fail (95 %)"
    )
