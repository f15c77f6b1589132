"""The examples of docs/home-assistant.md, as Home Assistant is given them."""

import re
from pathlib import Path

GUIDE = Path("docs/home-assistant.md")


def automations() -> str:
    """Return every automation of the guide as an `automations.yaml`."""
    found = re.findall(r"^```yaml\n(- alias:.*?)^```", GUIDE.read_text(), re.DOTALL | re.MULTILINE)
    assert found, f"{GUIDE} has no automation any more"
    return "".join(found)
