import json
from datetime import UTC, datetime, timedelta, timezone

import pytest
from support.mqtt_side import ATTIC, CONFIG, GARAGE

from bridge.model import Reason, ReplyTo, Status, Verdict
from bridge.mqtt import payloads

BANGKOK = timezone(timedelta(hours=7))
MOMENT = datetime(2024, 5, 1, 12, 0, 30, 123456, tzinfo=BANGKOK)


def test_words() -> None:
    """Values and availability are the bare words of docs/contract.md."""
    assert [payloads.on_off(True), payloads.on_off(False)] == [b"ON", b"OFF"]
    assert [payloads.availability(True), payloads.availability(False)] == [b"online", b"offline"]
    assert [payloads.mode(True), payloads.mode(False)] == [b"pulse", b"latch"]


@pytest.mark.parametrize(("hold_ds", "text"), [(1, b"0.1"), (25, b"2.5"), (255, b"25.5")])
def test_hold(hold_ds: int, text: bytes) -> None:
    """A hold time is seconds with one decimal."""
    assert payloads.hold(hold_ds) == text


def test_snapshot_has_every_channel_that_is_not_left_out() -> None:
    """The snapshot shows the configured channels alone, compactly."""
    made = payloads.snapshot(GARAGE, inputs=0x8002, outputs=0b1001)
    assert made == b'{"di":{"1":"OFF","16":"ON"},"do":{"1":"ON","2":"OFF","4":"ON"}}'


def test_snapshot_of_a_module_without_inputs() -> None:
    """A DO100 has an empty `di`."""
    assert payloads.snapshot(ATTIC, 0, 0x8000) == b'{"di":{},"do":{"16":"ON"}}'


def test_problem() -> None:
    """A problem tells reason, detail and the moment with its zone."""
    assert json.loads(payloads.problem("wrong_model", "es antwortet ein DO100", MOMENT)) == {
        "state": "ON",
        "reason": "wrong_model",
        "detail": "es antwortet ein DO100",
        "since": "2024-05-01T12:00:30+07:00",
    }
    assert payloads.no_problem() == b'{"state":"OFF"}'


def test_a_plain_verdict_has_nothing_more_than_it_must() -> None:
    """`id`, `reason`, `code`, `seen_on` and `detail` are left out where they do not apply."""
    verdict = Verdict("garage", "do/3", "ON", Status.DONE, 41)
    assert payloads.verdict(verdict) == (
        b'{"target":"do/3","payload":"ON","status":"done","ms":41}'
    )


def test_a_full_verdict() -> None:
    """A verdict has all known fields, without station and reply topic."""
    verdict = Verdict(
        station_id="garage",
        target="do",
        payload={"1": "ON"},
        status=Status.FAILED,
        ms=0,
        reason=Reason.MODULE_REFUSED,
        id=0,
        code=3,
        seen_on=False,
        detail="ERR=3",
        reply_to=ReplyTo("x", b"y"),
    )
    assert json.loads(payloads.verdict(verdict)) == {
        "target": "do",
        "payload": {"1": "ON"},
        "id": 0,
        "status": "failed",
        "reason": "module_refused",
        "ms": 0,
        "code": 3,
        "seen_on": False,
        "detail": "ERR=3",
    }


def test_text_goes_out_as_utf8() -> None:
    """Text of any language is written as it is; what has no UTF-8 form does no harm."""
    made = payloads.as_json({"name": "ประตู \ud800"})
    assert made == '{"name":"ประตู ?"}'.encode()


def test_log_line() -> None:
    """A log line names line and station only where it has one."""
    assert json.loads(payloads.log_line("warning", "m", None, "garage")) == {
        "level": "warning",
        "message": "m",
        "station": "garage",
    }
    assert json.loads(payloads.log_line("error", "m", "main", None)) == {
        "level": "error",
        "message": "m",
        "line": "main",
    }


def test_bridge_info_tells_what_runs_and_no_secret() -> None:
    """The info shows version, start, protocol, lines and stations; no password, no address."""
    info = payloads.bridge_info(CONFIG, "1.2.3", MOMENT.astimezone(UTC), "5")
    assert json.loads(info) == {
        "version": "1.2.3",
        "started": "2024-05-01T05:00:30+00:00",
        "protocol": "5",
        "lines": [
            {
                "id": "main",
                "protocol": "wisco",
                "baud": 9600,
                "stations": [
                    {"id": "garage", "name": "Garage Süd", "model": "DIO100", "address": 1},
                    {"id": "attic", "name": "Attic", "model": "DO100", "address": 13},
                ],
            }
        ],
    }
