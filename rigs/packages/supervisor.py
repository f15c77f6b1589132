"""What the app declares, by the schemas of Home Assistant's Supervisor itself.

`PYTHONPATH=rigs:CLONE python -m packages.supervisor`: CLONE is one of
https://github.com/home-assistant/supervisor (last tried with commit 090ef31 of 2026-08-21), and the
Python has its requirements.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from supervisor.apps.validate import SCHEMA_APP_CONFIG, SCHEMA_APP_TRANSLATIONS
from supervisor.store.validate import SCHEMA_REPOSITORY_CONFIG, repositories

_ROOT = Path(__file__).parents[2] / "packaging" / "home-assistant"
_WORDS = "wisco2mqtt/translations"
_SCHEMAS: dict[str, Callable[[Any], Any]] = {
    "repository.yaml": SCHEMA_REPOSITORY_CONFIG,
    "wisco2mqtt/config.yaml": SCHEMA_APP_CONFIG,
    f"{_WORDS}/en.yaml": SCHEMA_APP_TRANSLATIONS,
    f"{_WORDS}/th.yaml": SCHEMA_APP_TRANSLATIONS,
}


def main() -> int:
    """Returns 0 where each file is valid, and no key of it is one that the Supervisor drops."""
    dropped = 0
    for name, schema in _SCHEMAS.items():
        written = yaml.safe_load((_ROOT / name).read_text())
        unknown = sorted(written.keys() - schema(dict(written)).keys())
        dropped += len(unknown)
        print(f"{name}: valid, {len(written)} keys, of which dropped: {unknown or 'none'}")
    address = yaml.safe_load((_ROOT / "repository.yaml").read_text())["url"]
    repositories([address])
    print(f"an owner can add {address}")
    return 1 if dropped else 0


if __name__ == "__main__":
    sys.exit(main())
