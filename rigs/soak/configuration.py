"""The configuration of the house, and the changes that are made to it while the daemon runs."""

import random
from pathlib import Path

from soak.house import (
    AFTER_S,
    BASE,
    BAUD,
    COVERS,
    DEAD_TIME_S,
    HOLD_S,
    HOMES,
    INTERLOCKED,
    LINES,
    MAX_ON,
    MAX_ON_S,
    ON_LOSS,
    PULSE,
    READ_ONLY,
    WAY_S,
    Home,
    House,
)


class Configuration:
    """The file. Each change is one that the bridge has to follow at a reload."""

    def __init__(self, path: Path, built: House, broker_port: int) -> None:
        self.path = path
        self._house = built
        self._broker_port = broker_port
        self._client = 0
        self._turnaround_ms = dict.fromkeys(LINES, 5)

    def write(self) -> None:
        """Write it as it should be."""
        self.path.write_text(self._text())

    def change_line(self, line: str, chance: random.Random) -> None:
        """Change one line: it ends, and begins anew."""
        others = [ms for ms in range(1, 10) if ms != self._turnaround_ms[line]]
        self._turnaround_ms[line] = chance.choice(others)
        self.write()

    def change_client(self) -> None:
        """Change what a connection is made with: all begins anew, with another one."""
        self._client += 1
        self.write()

    def spoil(self) -> None:
        """Break it: the bridge has to run on as it was."""
        self.path.write_text(self._text().replace("baud:", "bauds:", 1))

    def _text(self) -> str:
        lines = "".join(
            f"  - id: {name}\n    port: {line.port}\n    baud: {BAUD}\n"
            f"    turnaround: {self._turnaround_ms[name]}ms\n"
            f"    protocol: {line.protocol}\n    stations:\n{_stations(name)}"
            for name, line in self._house.lines.items()
        )
        return (
            f"mqtt: {{host: 127.0.0.1, port: {self._broker_port}, base_topic: {BASE}, "
            f"protocol: 5, client_id: soak-{self._client}}}\n"
            f"state_dir: {self.path.parent}\nlines:\n{lines}"
        )


def _stations(line: str) -> str:
    return "".join(_station(home) for home in HOMES if home.line == line)


def _station(home: Home) -> str:
    covers = "".join(
        f"          {name}: {{open: {opens}, close: {closes}, open_time: {WAY_S}s, "
        f"close_time: {WAY_S}s}}\n"
        for name, (opens, closes) in COVERS.items()
        if home.has_covers
    )
    return (
        f"      - address: {home.address}\n        model: {home.model.name}\n"
        f"        id: {home.id}\n        interlock: [{list(INTERLOCKED)}]\n"
        f"        interlock_dead_time: {DEAD_TIME_S}s\n"
        + (f"        covers:\n{covers}" if covers else "")
        + f"        outputs:\n"
        f"          {PULSE}: {{mode: pulse, hold: {HOLD_S}s}}\n"
        f"          {READ_ONLY}: {{read_only: true}}\n"
        f"          {MAX_ON}: {{max_on: {MAX_ON_S}s}}\n"
        f'          {ON_LOSS}: {{on_loss: {{after: {AFTER_S}s, state: "ON"}}}}\n'
    )
