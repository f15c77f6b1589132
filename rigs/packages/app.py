"""`make app`: the repository that Home Assistant takes, with the wheel for its image."""

import re
import shutil
import sys
from pathlib import Path

from bridge import __version__
from packages.shell import ROOT, run

APP = ROOT / "build" / "home-assistant"


def make_app(target: Path = APP) -> Path:
    """Returns a folder that is to be pushed as a repository of its own."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(ROOT / "packaging" / "home-assistant", target)
    app = target / "wisco2mqtt"
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(app))
    shutil.copy(ROOT / "CHANGELOG.md", app)
    config = app / "config.yaml"
    versioned, count = re.subn(
        r'^version: ".*"$', f'version: "{__version__}"', config.read_text(), flags=re.MULTILINE
    )
    assert count == 1
    config.write_text(versioned)
    return target


if __name__ == "__main__":
    print(make_app())
