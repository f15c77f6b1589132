"""The release of the bridge before this one, in a folder and a virtual environment of its own."""

import io
import subprocess
import sys
import tarfile
from dataclasses import dataclass
from pathlib import Path

from home_assistant.releases import HOME


@dataclass(frozen=True, slots=True)
class Former:
    """A commit of this repository.

    Attributes:
        commit: What people run today: the last tag, once there is one.
    """

    commit: str

    @property
    def root(self) -> Path:
        """Return where it is installed."""
        return HOME.parent / "former" / self.commit

    @property
    def source(self) -> Path:
        """Return its files."""
        return self.root / "source"

    @property
    def python(self) -> Path:
        """Return the Python of its virtual environment, which has what it needs."""
        return self.root / "venv/bin/python"

    @property
    def installed(self) -> Path:
        """A file that is there when nothing is missing."""
        return self.root / ".installed"


FORMER = Former("e34f9ca")


def install(former: Former) -> None:
    """Installs it from the history of this clone, once."""
    if former.installed.exists():
        return
    extract(former.commit, former.source)
    subprocess.run([sys.executable, "-m", "venv", str(former.root / "venv")], check=True)
    pip = [str(former.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    lock = former.source / "requirements/run.txt"
    subprocess.run([*pip, "--no-deps", "--require-hashes", "--requirement", str(lock)], check=True)
    former.installed.touch()


def extract(commit: str, target: Path) -> None:
    """Puts the files of a commit into a folder, from the history of this clone."""
    command = ["git", "archive", "--format=tar", commit]
    archive = subprocess.run(command, capture_output=True, check=False)
    if archive.returncode != 0:
        sys.exit(f"this clone lacks the commit {commit}: git fetch --unshallow")
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
        files.extractall(target, filter="data")
