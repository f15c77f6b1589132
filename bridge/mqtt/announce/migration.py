"""Plans the messages to Home Assistant, from what was announced before.

The earlier announcements are retained on our discovery topics. A removed component, and a change
between the device and the single form, take several steps each: only in this order an entity keeps
its id, its history and the settings of its user.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge.config.names import is_id
from bridge.config.schema import Config
from bridge.mqtt.announce.discovery import node_prefix
from bridge.mqtt.announce.leftovers import only_retained
from bridge.mqtt.events import OutMessage, Subscription
from bridge.mqtt.payloads import CLEARED, as_json
from bridge.mqtt.strict_json import object_of

# "Unload this entity, but keep its settings: another topic will announce it." Home Assistant's
# documentation, MQTT, migration from single component to device-based discovery.
MIGRATE = b'{"migrate_discovery":true}'

Batch = tuple[OutMessage, ...]


@dataclass(frozen=True, slots=True)
class Announced:
    """The subject of a discovery topic of ours. Without a component it is a whole device."""

    node: str
    platform: str | None = None
    component: str | None = None


@dataclass(frozen=True, slots=True)
class Announcement:
    """The steps, with a pause between them. All messages are retained.

    Attributes:
        before: To send before the configurations.
        configs: The configurations, in order.
        after: To send after them, to tidy up.
    """

    before: tuple[Batch, ...]
    configs: Batch
    after: Batch

    @property
    def cleared(self) -> list[str]:
        """Return the topics that end up empty."""
        return [message.topic for message in self.after if not message.payload]


class DiscoveryTopics:
    """The discovery topics that belong to one bridge."""

    def __init__(self, config: Config) -> None:
        self._prefix = f"{config.homeassistant.prefix}/"
        self._node_prefix = node_prefix(config)

    def subscriptions(self) -> list[Subscription]:
        """Return the subscriptions with which they are read; topics of others match too."""
        filters = ("device/+/config", "+/+/+/config")
        return [only_retained(f"{self._prefix}{one}") for one in filters]

    def parse(self, topic: str) -> Announced | None:
        """Return the subject of a topic; None: it is not ours."""
        if not topic.startswith(self._prefix):
            return None
        match topic.removeprefix(self._prefix).split("/"):
            case ["device", node, "config"] if self._is_ours(node):
                return Announced(node)
            case [platform, node, component, "config"] if self._is_ours(node):
                return None if platform == "device" else Announced(node, platform, component)
        return None

    def device(self, node: str) -> str:
        """Return the topic of a whole device."""
        return f"{self._prefix}device/{node}/config"

    def single(self, node: str, platform: str, component: str) -> str:
        """Return the topic of one component."""
        return f"{self._prefix}{platform}/{node}/{component}/config"

    def _is_ours(self, node: str) -> bool:
        # A bridge with base topic a/b has node ids a__b__S. For one with base topic a that would be
        # a station b__S, which is not a valid id.
        return node.startswith(self._node_prefix) and is_id(node.removeprefix(self._node_prefix))


def announce(
    configs: Sequence[OutMessage], retained: Mapping[str, bytes], topics: DiscoveryTopics
) -> Announcement:
    """Plan the steps from the `retained` messages to `configs`."""
    return _Planner(configs, retained, topics).plan()


class _Planner:
    """Sorts the retained messages into steps. Used once."""

    def __init__(
        self, configs: Sequence[OutMessage], retained: Mapping[str, bytes], topics: DiscoveryTopics
    ) -> None:
        self._configs = {message.topic: message for message in configs}
        self._retained = retained
        self._topics = topics
        self._trimmed: list[OutMessage] = []
        self._migrating: list[OutMessage] = []
        self._after: list[OutMessage] = []

    def plan(self) -> Announcement:
        """Return the plan, after one look at each retained topic."""
        for topic, payload in self._retained.items():
            announced = self._topics.parse(topic)
            if announced is None:
                continue
            if topic in self._configs:
                self._trim(topic, payload)
            elif announced.component is None:
                self._drop_device(topic, payload, announced.node)
            else:
                self._drop_single(topic, announced)
        steps = (tuple(self._trimmed), tuple(self._migrating))
        before = tuple(step for step in steps if step)
        return Announcement(before, tuple(self._configs.values()), tuple(self._after))

    def _trim(self, topic: str, payload: bytes) -> None:
        """Remove components from a device that stays: first name them, then leave them out."""
        config = self._configs[topic]
        if payload == config.payload:  # the usual case: nothing to compare
            return
        document = _document(config.payload)
        components = _platforms(config.payload)
        removed = {k: p for k, p in _platforms(payload).items() if k not in components}
        if document is None or not removed:
            return
        named = {**document["components"], **_only_platforms(removed)}
        self._configs[topic] = _retain(topic, as_json({**document, "components": named}))
        self._after.append(config)

    def _drop_device(self, topic: str, payload: bytes, node: str) -> None:
        """Remove a device that is gone, or that is announced as single components from now on."""
        stay: dict[str, str] = {}
        removed: dict[str, str] = {}
        for component, platform in _platforms(payload).items():
            stays = self._topics.single(node, platform, component) in self._configs
            (stay if stays else removed)[component] = platform
        document = _document(payload)
        if stay and removed and document is not None:
            # A component that is unloaded and not announced again would remain as a ghost.
            components = {**document["components"], **_only_platforms(removed)}
            self._trimmed.append(_retain(topic, as_json({**document, "components": components})))
        if stay or payload == MIGRATE:
            self._migrating.append(_retain(topic, MIGRATE))
        self._after.append(_retain(topic, CLEARED))

    def _drop_single(self, topic: str, announced: Announced) -> None:
        """Remove a component that is gone, or that is announced with its device from now on."""
        device = self._configs.get(self._topics.device(announced.node))
        if device is not None and announced.component in _platforms(device.payload):
            self._migrating.append(_retain(topic, MIGRATE))
        self._after.append(_retain(topic, CLEARED))


def _only_platforms(removed: Mapping[str, str]) -> dict[str, Any]:
    return {component: {"platform": platform} for component, platform in removed.items()}


def _platforms(payload: bytes) -> dict[str, str]:
    """Return the platforms of the components of a device; empty if it cannot be read."""
    document = _document(payload)
    components = {} if document is None else document["components"]
    return {
        component: options["platform"]
        for component, options in components.items()
        if isinstance(options, dict) and isinstance(options.get("platform"), str)
    }


def _document(payload: bytes) -> dict[str, Any] | None:
    """Return the announcement of a device."""
    document = object_of(payload)
    return document if isinstance(document.get("components"), dict) else None


def _retain(topic: str, payload: bytes) -> OutMessage:
    return OutMessage(topic, payload, qos=1, retain=True)
