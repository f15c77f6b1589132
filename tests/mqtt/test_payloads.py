import json
from datetime import UTC, datetime, timedelta, timezone

from support.mqtt_side import ATTIC, CONFIG

from bridge.model import Reason, ReplyTo, Status, Verdict
from bridge.mqtt import payloads

BANGKOK = timezone(timedelta(hours=7))
MOMENT = datetime(2024, 5, 1, 12, 0, 30, 123456, tzinfo=BANGKOK)


def test_snapshot_of_a_module_without_inputs() -> None:
    """A DO100 has an empty `di`."""
    assert payloads.snapshot(ATTIC, 0, 0x8000) == b'{"di":{},"do":{"16":"ON"}}'


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
