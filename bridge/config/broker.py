"""The sections `mqtt` and `homeassistant`."""

import socket

from bridge.config.durations import duration
from bridge.config.endpoints import BROKER_PORTS, MAX_PORT, broker_url, host_name, server, web_link
from bridge.config.machine import MACHINE_ID_FILE, machine_name
from bridge.config.names import base_topic, topic_name
from bridge.config.nodes import Place, WrongValueError, items
from bridge.config.scalars import choice, whole
from bridge.config.schema import HomeAssistantConfig, MqttConfig, Server, TlsConfig
from bridge.config.tables import Table, Unique, table_of
from bridge.config.text import credential, label, readable_file, secret_file

_PROTOCOLS = {word: word for word in ("auto", "5", "3.1.1")}
_DISCOVERY = {word: word for word in ("device", "single", "off")}
_LANGUAGES = {word: word for word in ("en", "th", "de")}


def read_mqtt(place: Place) -> MqttConfig:
    """Read the section `mqtt`."""
    with table_of(place) as table:
        host, port, tls = _read_server(table)
        servers = _read_servers(table, _usual_port(tls))
        if servers:
            host, port = servers[0].host, servers[0].port
        topic = table.get("base_topic", base_topic, "wisco")
        config = MqttConfig(
            host=host,
            port=port,
            tls=tls,
            others=servers[1:],
            base_topic=topic,
            client_id=table.get("client_id", label, None) or _default_client_id(topic),
            protocol=table.get("protocol", choice(_PROTOCOLS), "auto"),
            username=table.get("username", credential, None),
            password=table.get("password", credential, None),
            command_qos=table.get("command_qos", whole(0, 1), 1),
            repeat_s=table.get("repeat", duration("1s", "60min"), None),
        )
        if "password" in table and "username" not in table:
            table.problem("password", "goes only with a username; write one")
    return config


def read_homeassistant(place: Place) -> HomeAssistantConfig:
    """Read the section `homeassistant`."""
    with table_of(place) as table:
        prefix = table.get("prefix", topic_name, "homeassistant")
        return HomeAssistantConfig(
            discovery=table.get("discovery", choice(_DISCOVERY), "device"),
            prefix=prefix,
            status_topic=table.get("status_topic", topic_name, f"{prefix}/status"),
            configuration_url=table.get("configuration_url", web_link, None),
            language=table.get("language", choice(_LANGUAGES), "en"),
        )


def _read_server(table: Table) -> tuple[str, int, TlsConfig | None]:
    """Read where the broker is: `url`, or `host` and `port`."""
    url = table.get("url", broker_url, None)
    host = table.get("host", host_name, "localhost")
    tls = table.get("tls", _read_tls, None)
    port = table.get("port", whole(1, MAX_PORT), _usual_port(tls))
    if "url" in table:
        for key in ("host", "port"):
            if key in table:
                table.problem(key, "cannot stand beside url; take one of the two out")
    if url is None:
        return host, port, tls
    if url.scheme == "mqtt" and "tls" in table:
        table.problem("tls", "cannot stand beside an mqtt:// url; write mqtts:// there")
    if url.scheme == "mqtts" and tls is None:
        tls = TlsConfig()
    return url.host, url.port, tls


def _read_servers(table: Table, default_port: int) -> tuple[Server, ...]:
    """Read `servers`, which stands in place of `host` and `port`."""
    used = Unique()

    def read(place: Place) -> tuple[Server, ...]:
        listed = items(place)
        if not listed:
            raise WrongValueError("names no server; write one at least, such as [10.0.0.2]")
        found = []
        for item in listed:
            each = item.read(server(default_port), None)
            if each is not None:
                used.claim(each, item, str(each))
                found.append(each)
        return tuple(found)

    if "servers" in table:
        for key in ("url", "host", "port"):
            if key in table:
                table.problem(key, "cannot stand beside servers; take one of the two out")
    return table.get("servers", read, ())


def _read_tls(place: Place) -> TlsConfig:
    with table_of(place) as table:
        config = TlsConfig(
            ca=table.get("ca", readable_file, None),
            cert=table.get("cert", readable_file, None),
            key=table.get("key", secret_file, None),
        )
        for one, other in (("cert", "key"), ("key", "cert")):
            if one in table and other not in table:
                table.problem(one, f"goes only together with {other}; write both")
    return config


def _usual_port(tls: TlsConfig | None) -> int:
    return BROKER_PORTS["mqtt" if tls is None else "mqtts"]


def _default_client_id(topic: str) -> str:
    machine = machine_name(MACHINE_ID_FILE, socket.gethostname())
    return f"wisco2mqtt-{machine}-{topic.replace('/', '-')}"
