"""The retained counts of an earlier run."""

import re
from collections.abc import Callable, Mapping

from bridge.config.schema import Config
from bridge.mqtt.topics import Topics

# By station id and input, as the bridge's own counts are.
FoundCounts = Callable[[Mapping[tuple[str, int], int]], None]

_COUNT = re.compile(rb"0|[1-9][0-9]{0,14}")  # more than a pulse a millisecond makes in 30,000 years


class CountTopics:
    """The topics of the inputs that `config` counts."""

    def __init__(self, config: Config) -> None:
        topics = Topics(config.mqtt.base_topic)
        self._inputs = {topics.count(*counted): counted for counted in config.counted}

    def __contains__(self, topic: str) -> bool:
        return topic in self._inputs

    def among(self, retained: Mapping[str, bytes]) -> dict[tuple[str, int], int]:
        """Return the counts among the retained messages; other messages are ignored."""
        return {
            self._inputs[topic]: int(payload)
            for topic, payload in retained.items()
            if topic in self._inputs and _COUNT.fullmatch(payload)
        }
