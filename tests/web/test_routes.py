"""Every route: behind the door, bounded, and as docs/openapi.yaml describes it."""

import http.client
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.openapi import OPENAPI, fits
from support.web_panel import PanelBench

from bridge.config.schema import WebConfig
from bridge.model import SettingsRead, ValuesChanged
from bridge.web.config_file import ConfigFile
from bridge.web.door import Level
from bridge.web.guest import Route

LOCKED = WebConfig(password="open sesame", token="t-program", read_token="t-eyes")  # noqa: S106  # the test's own
SECRETS = ("open sesame", "t-program", "t-eyes", "hunter2")
FILE = "web: {}\nmqtt: {username: u, password: hunter2}\nlines: []\n"


def key(name: str = "t-program") -> dict[str, str]:
    """The header of a program."""
    return {"Authorization": f"Bearer {name}"}


@pytest.fixture(name="locked")
def _locked(tmp_path: Path) -> Iterator[PanelBench]:
    """A panel with keys, and a file."""
    path = tmp_path / "config.yaml"
    path.write_text(FILE)
    with PanelBench(LOCKED, file=ConfigFile(path, {"HOME": str(tmp_path)})) as bench:
        yield bench


@pytest.fixture(name="bench")
def _bench() -> Iterator[PanelBench]:
    """A panel without keys, on loopback."""
    with PanelBench() as bench:
        yield bench


def _routes() -> list[Route]:
    return list(PanelBench().panel.routes)


def test_the_description_names_every_route_and_no_other() -> None:
    """docs/openapi.yaml; the files of the page are no part of it."""
    files = {"/", *(route.path for route in _routes() if "." in route.path)}
    served = {(r.path, r.method.lower()) for r in _routes() if r.path not in files}
    described = {(path, method) for path, found in OPENAPI["paths"].items() for method in found}
    assert served == described


@pytest.mark.parametrize("route", _routes(), ids=lambda route: f"{route.method} {route.path}")
def test_no_route_answers_without_a_key(locked: PanelBench, route: Route) -> None:
    """But for the page, the form for the password, and the watchdog's question; none tells more."""
    answer = locked.ask(route.method, route.path)
    if route.path == "/health":
        assert answer.document == {"status": "ok"}
    elif route.level is Level.OPEN:
        assert route.path in {"/", "/api/login", "/api/logout"} or "." in route.path
    else:
        assert answer.status == 401
    assert not [secret for secret in SECRETS if secret in answer.body.decode()]
    assert locked.line.commands == []


@pytest.mark.parametrize("route", _routes(), ids=lambda route: f"{route.method} {route.path}")
def test_a_key_that_only_looks_switches_and_saves_nothing(locked: PanelBench, route: Route) -> None:
    """Each route says so by itself."""
    if route.level is Level.SWITCH:
        assert locked.ask(route.method, route.path, headers=key("t-eyes")).status == 403


@pytest.mark.parametrize("route", _routes(), ids=lambda route: f"{route.method} {route.path}")
def test_every_route_turns_away_a_foreign_name(locked: PanelBench, route: Route) -> None:
    """The page of a stranger whose name points to us gets nothing, not even a file."""
    answer = locked.ask(route.method, route.path, headers={**key(), "Host": "evil.example"})
    assert answer.status == 421


@pytest.mark.parametrize("route", _routes(), ids=lambda route: f"{route.method} {route.path}")
def test_what_changes_something_is_no_get(route: Route) -> None:
    """A relay never switches by a link or a picture."""
    if route.method == "GET" and route.level is Level.SWITCH:
        assert route.path in {"/api/config", "/api/ports", "/api/backup"}


@pytest.mark.parametrize(
    "path",
    [
        "/../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "//etc/passwd",
        "/static/../api/state",
        "/api/state/",
        "/API/STATE",
        "/index.html%00",
        "/api",
        "/config.yaml",
    ],
)
def test_a_path_trick_leads_nowhere(locked: PanelBench, path: str) -> None:
    """No path is ever made of what was asked for."""
    assert locked.ask("GET", path, headers=key()).status == 404


def test_all_answers_forbid_inline_code_and_frames_of_others(locked: PanelBench) -> None:
    """The page, an answer, a refusal, and what is not there."""
    for path in ("/", "/api/state", "/nothing"):
        for headers in ({}, key()):
            found = locked.ask("GET", path, headers=headers).headers
            policy = found["content-security-policy"]
            assert "default-src 'none'" in policy
            assert "unsafe" not in policy
            assert "http:" not in policy
            assert found["x-content-type-options"] == "nosniff"


def test_a_password_opens_a_session(locked: PanelBench) -> None:
    """Its cookie is out of reach for scripts and for other sites."""
    assert locked.ask("POST", "/api/login", {"password": "no"}).status == 401
    answer = locked.ask("POST", "/api/login", {"password": "open sesame"})
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    session = {"Cookie": cookie.split(";")[0]}
    assert locked.ask("GET", "/api/state", headers=session).status == 200

    locked.ask("POST", "/api/logout", headers=session)
    assert locked.ask("GET", "/api/state", headers=session).status == 401


def test_many_wrong_keys_are_told_in_the_log(
    locked: PanelBench, caplog: pytest.LogCaptureFixture
) -> None:
    """With the address, and without the keys; the log is bounded as all of it."""
    answers = [locked.ask("GET", "/api/state", headers=key(f"guess{n}")).status for n in range(8)]
    assert answers == [401] * 5 + [429] * 3
    told = [one.getMessage() for one in caplog.records if "wrong keys" in one.getMessage()]
    assert told
    assert "127.0.0.1" in told[0]
    assert "guess" not in told[0]


def test_the_state_is_as_described(bench: PanelBench) -> None:
    """With values, modes and a verdict in it."""
    bench.hear(ValuesChanged("garage", 0b101, 0))
    bench.hear(ValuesChanged("garage", 0b100, 1))
    bench.hear(SettingsRead("garage", None))
    bench.command("garage", "do/1", "ON")
    document = fits(bench.ask("GET", "/api/state"), "/api/state", "get")
    assert document["state"]["station/garage"]["di"]["on"] == [3]
    assert [one["kind"] for one in document["happened"]][-3:] == ["value", "value", "verdict"]


def test_health_is_ok_or_not_and_the_rest_wants_a_key(locked: PanelBench) -> None:
    """The watchdog has none. A main thread that stands still for half a minute is not ok."""
    for headers, more in (({}, {}), (key("wrong"), {}), (key("t-eyes"), {"broker": "online"})):
        answer = locked.ask("GET", "/health", headers=headers)
        assert fits(answer, "/health", "get") == {"status": "ok", **more}
    locked.stuck_s = 30.0
    locked.wait(lambda: locked.ask("GET", "/health").status == 503)
    assert fits(locked.ask("GET", "/health"), "/health", "get") == {"status": "not ok"}


def test_figures_are_told(bench: PanelBench) -> None:
    """They count verdicts."""
    bench.command("garage", "do/1", "ON")
    bench.wait(lambda: bench.state()["state"]["bridge"]["commands"])
    figures = bench.ask("GET", "/metrics").body.decode()
    assert 'wisco2mqtt_commands_total{status="done"} 1.0\n' in figures
    assert 'wisco2mqtt_station_up{station="garage"} 1.0\n' in figures
    assert figures.endswith("# EOF\n")


def test_a_configuration_is_shown_without_its_secrets(locked: PanelBench) -> None:
    """And saved with them."""
    shown = fits(locked.ask("GET", "/api/config", headers=key()), "/api/config", "get")
    assert shown["text"] == FILE.replace("hunter2", "'***'").replace(": u,", ": '***',")
    text = shown["text"].replace("mqtt: {", "mqtt: {host: broker.lan, ")
    body = {"text": text, "version": shown["version"]}
    saved = fits(locked.ask("PUT", "/api/config", body, headers=key()), "/api/config", "put")
    new = FILE.replace("mqtt: {", "mqtt: {host: broker.lan, ")
    assert Path(saved["file"]).read_text() == new
    assert Path(saved["copy"]).read_text() == FILE
    locked.wait(lambda: locked.reloads == 1)


def test_a_file_that_changed_meanwhile_is_not_replaced(locked: PanelBench) -> None:
    """Of two people who edit it the second is told."""
    shown = locked.ask("GET", "/api/config", headers=key()).document
    Path(shown["file"]).write_text(FILE + "# mine\n")
    body = {"text": shown["text"], "version": shown["version"]}
    answer = locked.ask("PUT", "/api/config", body, headers=key())
    fits(answer, "/api/config", "put")
    assert answer.status == 409
    assert Path(shown["file"]).read_text() == FILE + "# mine\n"
    assert locked.reloads == 0


def test_what_check_refuses_is_not_saved(locked: PanelBench) -> None:
    """The problems come with line and column, as those of `check`."""
    shown = locked.ask("GET", "/api/config", headers=key()).document
    text = shown["text"] + "wbe: {}\n"
    checked = fits(
        locked.ask("POST", "/api/check", {"text": text}, headers=key()), "/api/check", "post"
    )
    assert [(one["line"], one["column"]) for one in checked["problems"]] == [(4, 1)]
    body = {"text": text, "version": shown["version"]}
    answer = locked.ask("PUT", "/api/config", body, headers=key())
    assert answer.status == 422
    assert fits(answer, "/api/config", "put")["problems"] == checked["problems"]
    assert Path(shown["file"]).read_text() == FILE


@pytest.mark.parametrize("length", ["100000000", "-1", "nonsense", "99999999999999999999"])
def test_a_body_that_is_too_long_is_not_read(locked: PanelBench, length: str) -> None:
    """It is refused by what it says of itself; what lies about it is cut off."""
    try:
        answer = locked.ask("POST", "/api/command", b"{}", {**key(), "Content-Length": length})
    except (OSError, http.client.HTTPException):
        return
    assert answer.status == 413


def test_an_unknown_body_of_login_is_refused(locked: PanelBench) -> None:
    """Any JSON, and what is none."""
    for body in (b"", b"[]", b"{", b"\xff", b'{"password": 1}', b"[" * 4000):
        assert locked.ask("POST", "/api/login", body).status == 400
    assert json.loads(locked.ask("POST", "/api/login", b"{}").body)["error"]
