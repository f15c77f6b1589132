"""The examples of docs/home-assistant.md, as Home Assistant is given them."""

import re
from pathlib import Path

GUIDE = Path("docs/home-assistant.md")
_NEWER = "trigger: event.received"  # which older releases do not know


def automations(*, newer: bool) -> str:
    """Return every automation of the guide that a release knows as an `automations.yaml`."""
    found = re.findall(r"^```yaml\n(- alias:.*?)^```", GUIDE.read_text(), re.DOTALL | re.MULTILINE)
    assert any(_NEWER in one for one in found), f"{GUIDE} has no automation for newer releases"
    return "".join(one for one in found if newer or _NEWER not in one)
