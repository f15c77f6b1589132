"""What the bridge switched without a command, kept for those that were away meanwhile."""

from collections import deque
from collections.abc import Callable, Container
from datetime import datetime

from bridge.model import Status, Verdict
from bridge.mqtt.payloads import as_json, verdict_fields

_KEPT = 20  # of a station: one `on_loss` may order all 16 outputs of a DO100


class OwnActions:
    """The last orders of the configuration (`Verdict.by`), by station. They end with the run."""

    def __init__(self) -> None:
        self._made: dict[str, deque[tuple[Verdict, float]]] = {}

    def add(self, verdict: Verdict, now: float) -> None:
        """Keep one; it was made at `now`."""
        self._made.setdefault(verdict.station_id, deque(maxlen=_KEPT)).appendleft((verdict, now))

    def keep(self, station_ids: Container[str]) -> None:
        """Forget the stations that are configured no more."""
        self._made = {name: made for name, made in self._made.items() if name in station_ids}

    @property
    def station_ids(self) -> list[str]:
        """Return the stations for which there is a payload."""
        return list(self._made)

    def payload(self, station_id: str, wall: Callable[[float], datetime]) -> bytes:
        """Return what is published of a station, the newest first; `wall` converts instants."""
        made = self._made[station_id]
        actions = [
            {"at": wall(at).isoformat(timespec="seconds"), **verdict_fields(verdict)}
            for verdict, at in made
        ]
        return as_json({"last": _in_words(made[0][0]), "actions": actions})


def _in_words(verdict: Verdict) -> str:
    words = f"{verdict.target} {verdict.payload} by {verdict.by}"
    if verdict.status is Status.DONE:
        return words
    return f"{words}: {(verdict.reason or verdict.status).replace('_', ' ')}"
