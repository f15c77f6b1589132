"""Topics, payloads and discovery (all pure), and the MQTT client."""

import sys
import urllib
from importlib import import_module
from types import ModuleType
from typing import Any


def _spare(name: str) -> None:
    """Let a module of `urllib` be loaded when something of it is used, not when it is imported."""
    full = f"urllib.{name}"
    if full in sys.modules:
        return
    later = ModuleType(full)

    def load(attribute: str) -> Any:
        if sys.modules.get(full) is later:
            del sys.modules[full]
        return getattr(import_module(full), attribute)

    later.__getattr__ = load  # type: ignore[method-assign]  # PEP 562
    sys.modules[full] = later
    setattr(urllib, name, later)


# paho imports it for proxies, which no connection of ours has, and it takes two megabytes.
_spare("request")
