"""The broker that end-to-end tests run on: mosquitto, or the one that `BROKER` names.

`make test-brokers` runs them on each of the others.
"""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from support.mosquitto import Mosquitto
from support.other_brokers import Nats, RabbitMq

Broker: TypeAlias = Mosquitto | Nats | RabbitMq

NAME = os.environ.get("BROKER", "mosquitto")
_KINDS: dict[str, Callable[[Path], Broker]] = {
    "mosquitto": Mosquitto,
    "nats": Nats,
    "rabbitmq": RabbitMq,
}

SPEAKS_MQTT_5 = NAME == "mosquitto"
# MQTT 3.1.1 shows the flag on what was stored alone: a live message does not say that it is kept.
RETAIN_SHOWS = SPEAKS_MQTT_5
WILDCARDS_SHOW_RETAINED = NAME != "rabbitmq"


def new_broker(directory: Path) -> Broker:
    """Returns one that is not started yet, without users or rights."""
    return _KINDS[NAME](directory)


def version() -> str:
    """Returns the broker's name and version, as its package has them."""
    package = {"mosquitto": "mosquitto", "nats": "nats-server", "rabbitmq": "rabbitmq-server"}[NAME]
    asked = ["dpkg-query", "--show", "--showformat", "${Package} ${Version}", package]
    told = subprocess.run(asked, capture_output=True, text=True, check=False)
    return told.stdout or package
