"""Advice on refusals of a broker, by the reason codes of MQTT 5.

The codes of CONNACK, SUBACK, PUBACK and DISCONNECT are the same; paho gives the return codes of
MQTT 3.1.1 as these codes too.
"""

from dataclasses import dataclass

UNSPECIFIED = 0x80
UNSUPPORTED_VERSION = 0x84
KEEPALIVE_TIMEOUT = 0x8D
SESSION_TAKEN_OVER = 0x8E
PACKET_TOO_LARGE = 0x95
NO_RETAIN = 0x9A
NO_QOS = 0x9B
NO_WILDCARDS = 0xA2

_USER = "check mqtt.username and mqtt.password"
_LIST = "check its access list"
_TOPIC = "it takes no topic of this form or depth: choose another mqtt.base_topic"
_BUSY = "it has too much to do, or too many clients: look at its log"
_QUOTA = "a quota of this user is used up: look at the broker's limits"
_ELSEWHERE = "set mqtt.host to the server that it names"
_LARGE = "raise its limit for packets, or set homeassistant.discovery to single"

_ADVICE = {
    0x85: "it does not like our client id: set mqtt.client_id",
    0x86: _USER,
    0x87: _LIST,
    0x88: _BUSY,
    0x89: _BUSY,
    0x8A: "it has banned us: look at its log",
    0x8B: "it is being stopped",
    0x8C: _USER,
    KEEPALIVE_TIMEOUT: "it heard nothing of us: look at the network",
    0x8F: _TOPIC,
    0x90: _TOPIC,
    0x93: "too many messages were on their way: look at its receive maximum",
    PACKET_TOO_LARGE: _LARGE,
    0x96: "we publish too fast for it: raise its limit of messages",
    0x97: _QUOTA,
    0x98: "its administrator did that: ask there",
    0x99: "it takes no such payload: look at what it checks",
    NO_RETAIN: "it keeps no retained messages: from now on we publish without that",
    NO_QOS: "it takes a lower QoS alone: from now on we publish with QoS 0",
    0x9C: _ELSEWHERE,
    0x9D: _ELSEWHERE,
    0x9E: "it takes no shared subscriptions",
    0x9F: "we connect too often for it: look at its limits",
    0xA0: "it ends connections after a time: look at its limits",
    NO_WILDCARDS: "it allows no wildcards",
}
_OTHERWISE = "look at the broker's log"


def advice(code: int) -> str:
    """Return advice on a reason code, for the end of a log line."""
    return _ADVICE.get(code, _OTHERWISE)


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer of the broker: a reason code, and its name."""

    code: int
    text: str

    @property
    def is_failure(self) -> bool:
        """Return whether it was refused."""
        return self.code >= UNSPECIFIED

    @property
    def told(self) -> str:
        """Return the answer in words, with advice."""
        return f"{self.text}; {advice(self.code)}"
