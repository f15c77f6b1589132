"""Debian's Chromium, as the user of the panel has it."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

AXE = Path(os.environ.get("AXE", "")) / "node_modules/axe-core/axe.min.js"
TABS = ("modules", "lines", "happened", "find", "config")
_CHROMIUM = "/usr/bin/chromium"
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",  # it asks nobody else
)
_PATIENCE_MS = 30_000.0


@contextmanager
def chromium() -> Iterator[Browser]:
    """One browser."""
    expect.set_options(timeout=_PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=list(_ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def visitor(
    browser: Browser,
    url: str,
    *,
    width: int = 1200,
    height: int = 900,
    scheme: Any = "light",
    language: str = "en-GB",
) -> Iterator[Page]:
    """A page of a fresh visitor; what its console complains of fails the test."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, locale=language
    )
    page = context.new_page()
    page.set_default_timeout(_PATIENCE_MS)
    told: list[str] = []
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("console", lambda one: told.append(one.text) if _is_complaint(one.text) else None)
    page.goto(url)
    try:
        yield page
        assert told == []
    finally:
        context.close()


def _is_complaint(text: str) -> bool:
    """Return whether the page broke its own rules; that a server is away is no mistake of it."""
    return "Content Security Policy" in text or "Error:" in text


def terminal(page: Page, module: str, name: str) -> Locator:
    """Return the row of an output or an input, by its name."""
    return page.get_by_role("article", name=module).get_by_role("listitem").filter(has_text=name)


def violations(page: Page) -> list[str]:
    """Return what axe finds, one line each."""
    # By the protocol of the debugger: the page itself may run no code that is not its own.
    page.evaluate(AXE.read_text())
    found: dict[str, Any] = page.evaluate("() => axe.run(document)")
    return [
        f"{one['id']}: {json.dumps([node['html'][:160] for node in one['nodes'][:3]])}"
        for one in found["violations"]
    ]
