"""docs/troubleshooting.md speaks of what the programs really print."""

from pathlib import Path

import pytest

from bridge.model import Reason

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "troubleshooting.md").read_text()
CODE = "".join(
    path.read_text().replace('"\n            "', "").replace('"\n        "', "")
    for path in (ROOT / "bridge").rglob("*.py")
)
# Beginnings and parts of messages, as they stand in both.
PRINTED = [
    "no such device: is the adapter plugged in?",
    "permission denied: add the user to the group dialout",
    "another program holds it: stop that one first",
    "the device hung up: is the adapter still plugged in?",
    "nobody answered: is the panel powered, are A and B the right way round?",
    "finds out who does",
    "does not answer",
    "bytes that nobody asked for: another master on this line?",
    "changed unasked to",
    "nothing passed",
    "bytes, and not one frame",
    "but it answers an input read as a DIO100 does",
    "wrong model",
]


@pytest.mark.parametrize("message", PRINTED)
def test_a_message_that_is_explained_is_printed(message: str) -> None:
    """A reader searches for the words that he sees."""
    assert message in TEXT
    assert message in CODE


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_of_a_verdict_is_explained(reason: Reason) -> None:
    """Each tells what to do; interlocks are not there yet."""
    assert f"`{reason}`" in TEXT or reason is Reason.INTERLOCK
