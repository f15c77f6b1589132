"""What a real mosquitto lets the client do: password, TLS, access list."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.certificates import make_authority
from support.event_log import wait_until, warnings_in
from support.mqtt_probe import MqttProbe
from support.running_client import (
    COMMANDS,
    MakeMosquitto,
    both_versions,
    config_for,
    message,
    running,
)

from bridge.config.schema import TlsConfig
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Received,
    Subscription,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged


def test_a_denied_publish_is_named_once_and_counts_as_answered(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """The reason code of a PUBACK is read: the log has topic and reason, once a connection."""
    acl = "topic read b/#\ntopic write b/mine\n"
    broker = make_mosquitto(acl=acl)
    with running(config_for(broker.port, "5")) as (client, events):
        events.wait(Connected)
        tokens = [client.publish(message("secret-payload", topic="b/theirs")) for _ in range(3)]
        tokens.append(client.publish(message("secret-payload", topic="b/mine")))
        events.wait(Acknowledged, 4)
        assert [one.token for one in events.of(Acknowledged)] == tokens
        assert client.counters.failed_publishes == 3
    assert warnings_in(caplog) == [
        "the broker did not take a message to 'b/theirs': Not authorized; check its access list"
    ]
    assert "secret-payload" not in caplog.text


def test_a_denied_subscription_is_named_in_the_log(
    make_mosquitto: MakeMosquitto, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A SUBACK that refuses a filter is told once, over reconnects too; the rest works."""
    plugins = sorted(Path("/usr/lib").glob("**/mosquitto_dynamic_security.so"))
    if not plugins:
        pytest.skip("mosquitto's dynamic security plugin is not installed")
    rules = tmp_path / "rules.json"
    rules.write_text(DENY_B)
    options = [f"plugin {plugins[0]}", f"plugin_opt_config_file {rules}"]
    broker = make_mosquitto(options=options)
    allowed = Subscription("allowed/#")
    with running(config_for(broker.port, "5"), COMMANDS, allowed) as (client, events):
        events.wait(Connected)
        broker.restart()
        events.wait(Connected, 2)
        client.publish(message("hello", topic="allowed/1"))
        assert events.wait(Received).topic == "allowed/1"
    assert [line for line in warnings_in(caplog) if "denies" in line] == [
        "the broker denies the subscription to b/+/set: Not authorized; check its access list"
    ]


DENY_B = """{
  "defaultACLAccess": {
    "publishClientSend": true, "publishClientReceive": true,
    "subscribe": false, "unsubscribe": true
  },
  "clients": [],
  "groups": [{"groupname": "all", "roles": [{"rolename": "all"}], "clients": []}],
  "roles": [{"rolename": "all",
    "acls": [{"acltype": "subscribePattern", "topic": "allowed/#", "allow": true}]}],
  "anonymousGroup": "all"
}"""


@both_versions
def test_a_wrong_password_says_what_to_do(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture, protocol: str
) -> None:
    """The log names user and settings, never the password; right ones connect."""
    broker = make_mosquitto(users={"wisco": "right"})
    config = replace(config_for(broker.port, protocol), username="wisco", password="wrong-one")  # noqa: S106  # the test's own
    with running(config) as (client, events):
        wait_until(lambda: client.trouble is not None)
        assert events.all == []
    assert "refuses user 'wisco'" in caplog.text
    assert "check mqtt.username and mqtt.password" in caplog.text
    assert "wrong-one" not in caplog.text
    with running(replace(config, password="right")) as (_, events):  # noqa: S106  # the test's own
        events.wait(Connected)


def test_tls_with_the_right_authority_connects(make_mosquitto: MakeMosquitto) -> None:
    """The broker's certificate is verified, and large messages cross TLS whole."""
    broker = make_mosquitto(tls=True)
    assert broker.tls_port is not None
    config = replace(
        config_for(broker.tls_port), host="localhost", tls=TlsConfig(ca=broker.directory / "ca.crt")
    )
    with MqttProbe(broker.port) as probe, running(config) as (_, events):
        events.wait(Connected)
        probe.publish("b/garage/set", b"x" * 250_000)
        for n in range(20):
            probe.publish("b/garage/set", str(n))
        assert len(events.wait(Received).payload) == 250_000
        assert events.wait(Received, 21).payload == b"19"


def test_a_client_certificate_is_shown(make_mosquitto: MakeMosquitto) -> None:
    """A broker that asks for a certificate gets the configured one."""
    broker = make_mosquitto(tls=True, options=["require_certificate true"])
    assert broker.tls_port is not None
    here = broker.directory
    tls = TlsConfig(here / "ca.crt", here / "client.crt", here / "client.key")
    config = replace(config_for(broker.tls_port), host="localhost", tls=tls)
    with running(config) as (_, events):
        events.wait(Connected)


# paho leaves the socket of a failed handshake to its finaliser, which closes it and says so.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ("authority", "certificate verify failed"),
        ("name", "certificate is not valid for '127.1'"),
        ("file", "No such file"),
    ],
)
def test_tls_that_does_not_verify_is_refused(
    make_mosquitto: MakeMosquitto, tmp_path: Path, wrong: str, cause: str
) -> None:
    """Another authority, another name, or a file that is not there: no connection."""
    broker = make_mosquitto(tls=True)
    assert broker.tls_port is not None
    make_authority(tmp_path)
    authority = {
        "authority": tmp_path / "ca.crt",
        "name": broker.directory / "ca.crt",
        "file": tmp_path / "no such file",
    }[wrong]
    # 127.1 is how the resolver abbreviates 127.0.0.1; no certificate names it.
    host = "127.1" if wrong == "name" else "localhost"
    config = replace(config_for(broker.tls_port), host=host, tls=TlsConfig(ca=authority))
    with running(config) as (client, events):
        wait_until(lambda: client.trouble is not None)
        assert cause in str(client.trouble)
        assert events.all == []
