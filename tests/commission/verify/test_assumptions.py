"""The readings of the manual: one table in the docs, one in the code, one in the simulator."""

import re
from pathlib import Path

from bridge.commission.verify.assumptions import ASSUMPTIONS
from bridge.simulator.dialect import READINGS, Dialect

DOCS = Path(__file__).parents[3] / "docs"


def _ids(page: str, title: str) -> list[str]:
    text = (DOCS / page).read_text().partition(f"## {title}\n")[2].partition("\n## ")[0]
    return [
        name
        for row in re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
        for name in re.findall(r"`([a-z0-9-]+)`", row)
    ]


def test_the_docs_and_the_code_list_the_same_readings_in_one_order() -> None:
    """Each reading of docs/protocol.md has its row in the code's table, and no other has."""
    assert _ids("protocol.md", "Readings") == list(ASSUMPTIONS)


def test_each_reading_can_be_turned_round() -> None:
    """A dialect of the simulator goes with each reading."""
    assert set(READINGS.values()) == set(ASSUMPTIONS)
    assert set(READINGS) == set(Dialect)


def test_each_dialect_is_documented() -> None:
    """The page of the simulator names all dialects."""
    assert set(_ids("simulator.md", "Dialects")) == set(Dialect)


def test_the_code_names_no_other_reading() -> None:
    """Where a message names a reading, docs/protocol.md has it."""
    bridge = DOCS.parent / "bridge"
    named = {
        name
        for file in bridge.rglob("*.py")
        for name in re.findall(r"\breading ([a-z0-9]+-[a-z0-9-]+)", file.read_text())
    }
    assert named
    assert named <= set(ASSUMPTIONS)
