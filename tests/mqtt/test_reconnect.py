"""The pauses and the choice of protocol, without any network."""

from dataclasses import replace
from pathlib import Path

import pytest

from bridge.config.schema import MqttConfig, TlsConfig
from bridge.mqtt.reconnect import Backoff, Ended, Ending, ReconnectPlan, explain

STEADY = Backoff(jitter=0.0)
CONFIG = MqttConfig("broker", 1883, "b", "our-id", "auto", username="wisco")


def plan_for(protocol: str = "auto", backoff: Backoff = STEADY) -> ReconnectPlan:
    """A plan without jitter."""
    return ReconnectPlan(protocol, backoff)


@pytest.mark.parametrize(
    ("ends", "pauses"),
    [
        # They double up to ten seconds, so a broker is noticed within 12 s.
        ([(Ending.UNREACHABLE, 0)] * 7, [1, 2, 4, 8, 10, 10, 10]),
        # A broker that was restarted, however soon after the last time, is there a second later.
        (
            [(Ending.UNREACHABLE, 0), *[(Ending.UNREACHABLE, 0), (Ending.LOST, 0)] * 2],
            [1, 2, 1, 2, 1],
        ),
        # After a hang-up only a connection that lasted begins afresh.
        ([(Ending.HUNG_UP, lasted_s) for lasted_s in (0, 0, 29, 30, 0)], [1, 2, 4, 1, 2]),
        # Where both versions are refused there are two attempts a round.
        ([(Ending.VERSION, 0)] * 6, [0, 1, 0, 2, 0, 4]),
        ([(Ending.CREDENTIALS, 0)], [10]),
        # Two clients with one id would otherwise throw each other out several times a second.
        ([(Ending.TAKEN_OVER, 100)], [60]),
    ],
)
def test_the_pauses(ends: list[tuple[Ending, float]], pauses: list[float]) -> None:
    """What ended the connection, and how long it lasted, decides about the pause."""
    plan = plan_for()
    assert [plan.pause_after(ending, lasted_s) for ending, lasted_s in ends] == pauses


def test_the_pauses_between_rounds_over_a_cluster_stay_short() -> None:
    """A cluster that elects a leader refuses us for 9 s: we are there 3 s later at most."""
    plan = ReconnectPlan("3.1.1", STEADY, is_cluster=True)
    pauses = [plan.pause_after(Ending.NO_ANSWER, 0) for _ in range(5)]
    assert pauses == [1, 2, 3, 3, 3]
    assert plan.pause_after(Ending.CREDENTIALS, 0) == 10


def test_jitter_only_shortens() -> None:
    """Drawn pauses differ, and none is longer than promised."""
    plan = plan_for(backoff=Backoff(first_s=10, longest_s=10, jitter=0.2))
    pauses = {plan.pause_after(Ending.LOST, 0) for _ in range(50)}
    assert len(pauses) > 1
    assert all(8 <= pause <= 10 for pause in pauses)


def test_auto_falls_back_at_once_and_remembers_what_worked() -> None:
    """A broker that refuses 5 gets 3.1.1 without a pause, and first of all the next time."""
    plan = plan_for()
    assert plan.protocol == "5"
    assert plan.pause_after(Ending.VERSION, 0) == 0
    assert plan.protocol == "3.1.1"
    plan.connected()
    assert plan.pause_after(Ending.LOST, 100) == 1
    assert plan.protocol == "3.1.1"


def test_auto_asks_for_5_again_when_what_worked_is_refused() -> None:
    """A broker that was replaced by a newer one is found out."""
    plan = plan_for()
    plan.pause_after(Ending.VERSION, 0)
    plan.connected()
    assert plan.pause_after(Ending.VERSION, 0) == 0
    assert plan.protocol == "5"


def test_a_broker_that_went_away_during_the_fall_back_says_nothing_about_versions() -> None:
    """5 is asked first again: the refusal may have been the broker's end."""
    plan = plan_for()
    plan.pause_after(Ending.VERSION, 0)
    plan.pause_after(Ending.UNREACHABLE, 0)
    assert plan.protocol == "5"


@pytest.mark.parametrize("protocol", ["5", "3.1.1"])
def test_a_forced_protocol_is_kept(protocol: str) -> None:
    """A refusal of the version is waited out like any other failure."""
    plan = plan_for(protocol)
    assert plan.pause_after(Ending.VERSION, 0) == 1
    assert plan.protocol == protocol


def judged(plan: ReconnectPlan, *ends: tuple[Ending, float]) -> list[Ending]:
    """Return how the plan judges these ends, each with the length of its connection."""
    return [plan.judge(Ended(ending, "why"), lasted_s).ending for ending, lasted_s in ends]


def test_the_third_hang_up_in_a_row_counts_as_taken_over() -> None:
    """Old brokers do not say who took the session: they hang up, again and again."""
    end = (Ending.HUNG_UP, 60.0)
    expected = [Ending.HUNG_UP, Ending.HUNG_UP, Ending.TAKEN_OVER, Ending.TAKEN_OVER]
    assert judged(plan_for(), end, end, end, end) == expected


@pytest.mark.parametrize("other", [(Ending.UNREACHABLE, 0.0), (Ending.HUNG_UP, 120.0)])
def test_a_restart_or_a_long_life_is_no_take_over(other: tuple[Ending, float]) -> None:
    """A broker that was away, or a connection that lasted, breaks the row."""
    end = (Ending.HUNG_UP, 1.0)
    assert Ending.TAKEN_OVER not in judged(plan_for(), end, end, other, end, end)


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (Ending.UNREACHABLE, "why; check that it runs, and mqtt.host and mqtt.port"),
        (Ending.REFUSED, "why; check that it runs, and mqtt.host and mqtt.port"),
        (Ending.LOST, "lost the broker at broker:1883: why"),
        (Ending.HUNG_UP, "lost the broker at broker:1883: why"),
        (
            Ending.VERSION,
            "the broker at broker:1883 takes neither MQTT 5 nor 3.1.1: why; does it want TLS?",
        ),
        (
            Ending.CREDENTIALS,
            "refuses user 'wisco': why; check mqtt.username and mqtt.password",
        ),
        (
            Ending.TAKEN_OVER,
            "use the client id 'our-id'; stop it or set mqtt.client_id; waiting 60 s",
        ),
    ],
)
def test_each_ending_is_explained_with_what_to_do(ending: Ending, words: str) -> None:
    """One line says where, why and what its reader can do."""
    line = explain(Ended(ending, "why"), CONFIG, 60)
    assert line.startswith(("no connection to the broker", "lost the broker", "the broker"))
    assert "broker:1883" in line
    assert line.endswith(words)


def test_a_forced_protocol_that_is_refused_names_the_setting() -> None:
    """A refused forced protocol gives a message that names the setting."""
    line = explain(Ended(Ending.VERSION, "why"), replace(CONFIG, protocol="5"), 1)
    assert line == "the broker at broker:1883 does not take MQTT 5: why; see mqtt.protocol"


@pytest.mark.parametrize(
    ("tls", "guess"),
    [
        (TlsConfig(), "does it want a certificate of ours (mqtt.tls.cert)?"),
        (TlsConfig(cert=Path("c"), key=Path("k")), "does it speak MQTT on that port?"),
    ],
)
def test_a_broker_that_says_nothing_over_tls_is_not_asked_for_tls(
    tls: TlsConfig, guess: str
) -> None:
    """The guess is about what is not configured yet."""
    line = explain(Ended(Ending.NO_ANSWER, "why"), replace(CONFIG, tls=tls), 1)
    assert line.endswith(f": why; {guess}")


def test_what_openssl_says_leads_to_the_settings_of_tls() -> None:
    """An authority, a name, or a port without TLS: the broker itself runs."""
    cause = "[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed"
    line = explain(Ended(Ending.UNREACHABLE, cause), CONFIG, 1)
    assert line.endswith(f"{cause}; check mqtt.tls, and that mqtt.port is its port for TLS")
