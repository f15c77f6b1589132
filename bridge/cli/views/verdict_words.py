"""A verdict in words."""

from collections.abc import Mapping
from typing import Any

from bridge.model import Status


def outcome(verdict: Mapping[str, Any]) -> str:
    """Return what became of a command, in words."""
    status = verdict.get("status")
    detail = f"; {verdict['detail']}" if "detail" in verdict else ""
    if status == Status.DONE:
        unseen = ", but the read after it did not see it ON" * (verdict.get("seen_on") is False)
        return f"done in {verdict.get('ms')} ms{unseen}{detail}"
    code = f" (code {verdict['code']})" if "code" in verdict else ""
    return f"{status}: {verdict.get('reason')}{code}{detail}"
