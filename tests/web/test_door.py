"""The door of the panel, by itself: keys, sessions, wrong keys, foreign pages."""

from collections.abc import Mapping
from dataclasses import replace

import pytest

from bridge.config.schema import WebConfig
from bridge.web.door import Denied, Door, Knock, Level

LOCKED = WebConfig(password="open", token="program", read_token="eyes")  # noqa: S106  # the test's own
JSON = {"content-type": "application/json"}


def knock(
    method: str = "GET",
    headers: Mapping[str, str] | None = None,
    *,
    session: str | None = None,
    address: str = "10.0.0.9",
) -> Knock:
    """A request from a telephone in the house."""
    found = {"host": "10.0.0.2:8099", **(JSON if method != "GET" else {}), **(headers or {})}
    return Knock(address, method, found, session)


def bearer(token: str) -> Mapping[str, str]:
    """The header of a program."""
    return {"authorization": f"Bearer {token}"}


def status(door: Door, asked: Knock, level: Level, now: float = 0.0) -> int:
    """200 where the request is let in."""
    denied = door.objection(asked, level, now)
    return 200 if denied is None else denied.status


@pytest.mark.parametrize("level", [Level.LOOK, Level.SWITCH])
def test_without_a_key_nothing_is_shown_and_nothing_done(level: Level) -> None:
    """The answer says that a key is needed."""
    assert status(Door(LOCKED), knock(), level) == 401


def test_the_files_of_the_page_need_no_key() -> None:
    """Else there were no form to type the password into."""
    assert status(Door(LOCKED), knock(), Level.OPEN) == 200


@pytest.mark.parametrize(
    ("token", "looks", "switches"),
    [("program", 200, 200), ("open", 200, 200), ("eyes", 200, 403), ("wrong", 401, 401)],
)
def test_a_token_opens_what_it_is_for(token: str, looks: int, switches: int) -> None:
    """`read_token` looks only; a wrong one opens nothing."""
    door = Door(LOCKED)
    assert status(door, knock(headers=bearer(token)), Level.LOOK) == looks
    assert status(door, knock("POST", bearer(token)), Level.SWITCH) == switches


def test_a_session_opens_until_it_ends() -> None:
    """It is found by its cookie, for seven days, or until it is logged out."""
    door = Door(LOCKED)
    session = door.log_in(knock("POST"), "open", 0.0)
    assert isinstance(session, str)
    assert status(door, knock("POST", session=session), Level.SWITCH) == 200
    assert status(door, knock("POST", session=session + "x"), Level.SWITCH) == 401
    assert status(door, knock(session=session), Level.LOOK, now=8 * 86_400.0) == 401

    door.log_out(session)
    assert status(door, knock(session=session), Level.LOOK) == 401


def test_a_read_only_panel_switches_for_no_key() -> None:
    """Not even for the password."""
    door = Door(replace(LOCKED, read_only=True))
    assert status(door, knock("POST", bearer("open")), Level.SWITCH) == 403
    assert status(door, knock(headers=bearer("open")), Level.LOOK) == 200


def test_a_panel_without_a_password_lets_this_machine_in() -> None:
    """`check` allows that on loopback alone."""
    local = {"host": "localhost:8099"}
    assert status(Door(WebConfig()), knock("POST", local), Level.SWITCH) == 200


def test_wrong_keys_are_slowed_down() -> None:
    """Five at once, then one each 10 s; another client is not held up by it."""
    door = Door(LOCKED)
    tries = [door.log_in(knock("POST"), f"guess{n}", 0.0) for n in range(7)]
    assert [one.status for one in tries if isinstance(one, Denied)] == [401] * 5 + [429] * 2
    assert status(door, knock(headers=bearer("program")), Level.LOOK) == 429  # right, and too soon
    assert status(door, knock(headers=bearer("program"), address="10.0.0.8"), Level.LOOK) == 200
    assert status(door, knock(headers=bearer("program")), Level.LOOK, now=10.0) == 200


def test_the_addresses_of_one_ipv6_network_are_one_client() -> None:
    """A client has as many of them as it likes."""
    door = Door(LOCKED)
    for number in range(5):
        door.log_in(knock("POST", address=f"2001:db8::{number:x}"), "guess", 0.0)
    last = door.log_in(knock("POST", address="2001:db8::ffff"), "guess", 0.0)
    assert isinstance(last, Denied)
    assert last.status == 429


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("10.0.0.2:8099", 200),
        ("[fd00::2]:8099", 200),
        ("localhost:8099", 200),
        ("homeassistant:8099", 200),
        ("wisco.local", 200),
        ("evil.example", 421),
        ("evil.example:8099", 421),
        ("10.0.0.2.evil.example", 421),
        ("", 421),
        ("[", 421),
    ],
)
def test_a_name_that_a_stranger_can_have_is_turned_away(host: str, expected: int) -> None:
    """Else a page of his could have its own name point to the panel (DNS rebinding)."""
    asked = knock(headers={"host": host, **bearer("program")})
    assert status(Door(LOCKED), asked, Level.LOOK) == expected


def test_a_proxy_has_names_of_its_own() -> None:
    """Only from the configured address; pages of other sites are turned away there too."""
    door = Door(replace(LOCKED, proxy="172.30.32.2"))
    asked = {"host": "house.example", **bearer("program")}
    assert status(door, knock(headers=asked, address="172.30.32.2"), Level.LOOK) == 200
    assert status(door, knock(headers=asked, address="172.30.32.3"), Level.LOOK) == 421
    foreign = {**asked, "origin": "https://evil.example"}
    assert status(door, knock("POST", foreign, address="172.30.32.2"), Level.SWITCH) == 403
    own = {**asked, "origin": "https://house.example"}
    assert status(door, knock("POST", own, address="172.30.32.2"), Level.SWITCH) == 200


def test_wrong_keys_behind_a_proxy_are_those_of_its_client() -> None:
    """By the last address in its header, which it wrote itself; others may write what they like."""
    door = Door(replace(LOCKED, proxy="172.30.32.2"))

    def told(client: str, address: str = "172.30.32.2") -> int:
        headers = {"x-forwarded-for": f"1.2.3.4, {client}"}
        denied = door.log_in(knock("POST", headers, address=address), "guess", 0.0)
        return denied.status if isinstance(denied, Denied) else 200

    assert [told("10.0.0.7") for _ in range(6)] == [401] * 5 + [429]
    assert told("10.0.0.8") == 401
    assert [told(f"10.1.0.{n}", "10.0.0.9") for n in range(6)] == [401] * 5 + [429]


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://10.0.0.2:8098"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "cross-site", "origin": "http://10.0.0.2:8099"},
    ],
)
def test_a_page_of_another_site_switches_nothing(headers: Mapping[str, str]) -> None:
    """Not even in a browser that holds a session, or on a panel without a password."""
    for door in (Door(LOCKED), Door(WebConfig())):
        session = door.log_in(knock("POST"), "open", 0.0)
        asked = knock("POST", headers, session=session if isinstance(session, str) else None)
        assert status(door, asked, Level.SWITCH) == 403


def test_a_form_switches_nothing() -> None:
    """What a form can send without being asked for permission is no JSON."""
    asked = knock("POST", {"content-type": "text/plain", **bearer("program")})
    assert status(Door(LOCKED), asked, Level.SWITCH) == 415


def test_our_own_page_is_let_in() -> None:
    """With or without the header that newer browsers send."""
    own = {"origin": "http://10.0.0.2:8099", **bearer("program")}
    assert status(Door(LOCKED), knock("POST", own), Level.SWITCH) == 200
    newer = {"sec-fetch-site": "same-origin", **bearer("program")}
    assert status(Door(LOCKED), knock("POST", newer), Level.SWITCH) == 200


def test_the_sessions_are_bounded() -> None:
    """The oldest is forgotten."""
    door = Door(LOCKED)
    sessions = [door.log_in(knock("POST"), "open", 0.0) for _ in range(65)]
    first, last = str(sessions[0]), str(sessions[-1])
    assert status(door, knock(session=first), Level.LOOK) == 401
    assert status(door, knock(session=last), Level.LOOK) == 200
