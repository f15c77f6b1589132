"""The panel, as the owner uses it: what it shows is changed, and saved."""

import http.client
import json
from collections.abc import Mapping


def save_lines(lines: str, port: int, key: str | None = None) -> None:
    """Saves these lines where the configuration has none yet."""
    headers = {"Content-Type": "application/json"}
    if key is not None:
        headers["Authorization"] = f"Bearer {key}"
    shown = json.loads(_asked("GET", port, headers))
    text = shown["text"].replace("lines: []\n", lines)
    _asked("PUT", port, headers, json.dumps({"text": text, "version": shown["version"]}))


def _asked(method: str, port: int, headers: Mapping[str, str], body: str | None = None) -> bytes:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request(method, "/api/config", body, dict(headers))
    answer = connection.getresponse()
    told = answer.read()
    assert answer.status == http.HTTPStatus.OK, told
    return told
