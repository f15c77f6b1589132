"""Home Assistant's own pages in Chromium, as its user sees them."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager

from home_assistant.instance import HomeAssistant
from playwright.sync_api import Page, sync_playwright

LOADED_MS = 120_000  # the first visit loads the whole frontend, on a busy machine
_CHROMIUM = "/usr/bin/chromium"
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",  # it asks nobody else
)
_DAY_S = 86_400


@contextmanager
def page(assistant: HomeAssistant, path: str, width: int, height: int) -> Iterator[Page]:
    """Shows one page to a user who is logged in."""
    tokens = {
        "access_token": assistant.token,
        "token_type": "Bearer",
        "expires_in": _DAY_S,
        "expires": int(time.time() + _DAY_S) * 1000,
        "hassUrl": assistant.url,
        "clientId": f"{assistant.url}/",
        "refresh_token": "",
    }
    login = f"localStorage.setItem('hassTokens', {json.dumps(json.dumps(tokens))})"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=list(_ARGUMENTS))
        try:
            shown = browser.new_page(viewport={"width": width, "height": height})
            shown.set_default_timeout(LOADED_MS)
            shown.add_init_script(login)
            shown.goto(f"{assistant.url}{path}")
            yield shown
        finally:
            browser.close()


def device_path(assistant: HomeAssistant, identifier: str) -> str:
    """Return the address of the page of a device."""
    return f"/config/devices/device/{assistant.live.devices()[identifier]['id']}"
