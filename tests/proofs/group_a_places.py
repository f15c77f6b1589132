"""A relay switched wrongly because of its place: A10 in the configuration, A13 on the line."""

import os
import re
import subprocess
import sys
from pathlib import Path

from bridge.config.load import load_config
from bridge.errors import ConfigError
from proofs.figures import Figure, Run, proof

BAD_FILES = sorted((Path(__file__).parents[1] / "config" / "bad").glob("*.yaml"))
HOME = {"HOME": "/home/wisco"}
EX_CONFIG = 78
PATIENCE_S = 20.0
_EXPECTED = re.compile("^# expect (.*)$", re.MULTILINE)


def _expected(path: Path) -> list[str]:
    """What the file itself says to be wrong with it, as `LINE:COLUMN message`."""
    return _EXPECTED.findall(path.read_text(encoding="utf-8"))


def _is_refused(path: Path) -> bool:
    try:
        load_config(path, HOME)
    except ConfigError as error:
        return _expected(path) == [f"{it.line}:{it.column} {it.message}" for it in error.problems]
    return False


def _is_refused_by_the_command(path: Path) -> bool:
    """Whether `run` ends at once, with the problems on stderr."""
    command = [sys.executable, "-m", "bridge", "run", "-c", str(path)]
    try:
        ended = subprocess.run(
            command,
            env=os.environ | HOME,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    except subprocess.TimeoutExpired:
        return False
    told = [
        line.removeprefix(f"{path}:").replace(": ", " ", 1) for line in ended.stderr.split("\n")
    ]
    return ended.returncode == EX_CONFIG and told == [*_expected(path), ""]


@proof("A10")
def bad_configurations_are_refused(run: Run) -> Figure:
    """Each problem is told with its place, and nothing is started."""
    refused = sum(map(_is_refused, BAD_FILES))
    tried = BAD_FILES[:: run.scale.of(30, 1)]
    ended = sum(map(_is_refused_by_the_command, tried))
    return Figure(
        injected=f"{len(BAD_FILES)} bad files",
        seen=f"{refused} refused with their lines; run ended {ended} of {len(tried)} times with 78",
        promised="all refused, with line numbers",
        kept=refused == len(BAD_FILES) >= 30 and ended == len(tried),
    )
