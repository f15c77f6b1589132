"""The releases of Home Assistant that the tests run against, and where they are installed."""

import os
from dataclasses import dataclass
from pathlib import Path

_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
HOME = _CACHE / "wisco2mqtt" / "home-assistant"


@dataclass(frozen=True, slots=True)
class Release:
    """One release.

    Attributes:
        version: As PyPI knows it.
        suite: The Debian suite whose Python it runs on, in a chroot of its own. None: this one's.
        extras: Integrations that it imports although none of its manifests says so.
        pins: What it was released with and has no pin for.
        tries_ports: It takes a port of its web server for a trial until somebody keeps it.
        receives_events: It has the trigger `event.received`.
    """

    version: str
    suite: str | None
    extras: tuple[str, ...]
    pins: tuple[str, ...]
    tries_ports: bool
    receives_events: bool

    @property
    def root(self) -> Path:
        """Return where it is installed: a virtual environment, or a whole chroot."""
        return HOME / self.version

    @property
    def venv(self) -> Path:
        """Return its virtual environment, as the host sees it."""
        return self.root if self.suite is None else self.root / "opt/ha"

    @property
    def installed(self) -> Path:
        """A file that is there when nothing is missing."""
        return self.root / ".installed"

    def inside(self, path: Path) -> str:
        """Return the path inside the release of a path of the host."""
        return str(path) if self.suite is None else f"/{path.relative_to(self.root)}"

    def command(self, *words: str) -> list[str]:
        """Runs a program of the virtual environment."""
        program = [f"{self.inside(self.venv)}/bin/{words[0]}", *words[1:]]
        if self.suite is None:
            return program
        # A mount namespace of its own: nothing stays mounted, whatever ends how.
        script = 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"'
        return ["unshare", "--mount", "sh", "-c", script, str(self.root), *program]


OLD = Release(
    "2024.3.3",
    None,
    extras=(),
    pins=(
        "PyTurboJPEG",
        "SQLAlchemy",
        "fnv-hash-fast",
        "hassil",
        "home-assistant-intents",
        "numpy",
        "josepy<2",  # a later one took away what acme imports
    ),
    tries_ports=False,
    receives_events=False,
)
NEW = Release(
    "2026.11.0",
    "forky",
    extras=(
        "infrared",
        "radio_frequency",
        "ffmpeg",
        "tts",
        "camera",
        "conversation",
        "assist_pipeline",
        "hassio",
    ),
    pins=("numpy",),
    tries_ports=True,
    receives_events=True,
)
RELEASES = (OLD, NEW)
