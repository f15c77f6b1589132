"""Connections to a broker that are proven by pings."""

from bridge.mqtt.link import SETTLING_S, LinkCheck


def answer_ping(link: LinkCheck, now: float) -> None:
    """Send the ping that is due at `now`, and let it come back in the same instant."""
    payload = link.ping(now)
    assert payload is not None
    link.seen(payload, now)


def prove(link: LinkCheck, now: float) -> None:
    """Make a connection that has settled, and whose newest ping came back at `now`."""
    link.connected(now - 2 * SETTLING_S)
    answer_ping(link, now - 2 * SETTLING_S)
    answer_ping(link, now)
