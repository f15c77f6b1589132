"""The wheel, installed by pipx without an index: it runs, and what it advises works."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from packages.shell import PIPX, ROOT, base, copy_of, inside, run

_LOCK = ROOT / "requirements" / "debian.txt"
# What a person does: what the message says, with an index that is a folder here.
_TRY = """
export HOME=/root PATH=/root/.local/bin:$PATH PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels
pipx install /wheels/wisco2mqtt-*.whl 2>&1
echo; echo "version: $(wisco2mqtt --version)"
find /root/.local -path '*man1/wisco2mqtt.1' -o -path '*bridge/py.typed' | sed 's/^/has: /'
advice=$(wisco2mqtt completion bash 2>&1 | sed 's/.*(extra `cli`): //')
echo "advice: $advice"
sh -ec "$advice" 2>&1
echo; echo "completes: $(wisco2mqtt completion bash | grep -c wisco2mqtt)"
"""


def try_wheel(check: Callable[[bool, str], None]) -> None:
    """Installs it in a fresh Debian 12, and adds a library as its message advises."""
    system = copy_of(base("bookworm", PIPX), "pipx")
    wheels = system / "wheels"
    build = (sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheels))
    run(*build)
    fetch_wheels(wheels)
    told = inside(system, _TRY)
    for word in ("version: wisco2mqtt ", "man1/wisco2mqtt.1", "bridge/py.typed", "advice: pipx "):
        line = next((line for line in told.splitlines() if word in line), "")
        check(bool(line), f"pipx: {line or f'no {word}'}")
    completes = told.rpartition("completes: ")[2].strip()
    check(completes.isdigit() and int(completes) > 0, f"pipx: completion has {completes} lines")
    shutil.rmtree(system)


def fetch_wheels(folder: Path) -> None:
    """Fetches the locked libraries as wheels for Debian 12, checked by their hashes."""
    # Of a wheel with machine code the Debian package takes only the Python: any machine will do.
    fits = ("--platform", "manylinux2014_x86_64", "--platform", "any")
    python = ("--python-version", "3.11", "--implementation", "cp", "--only-binary", ":all:")
    locked = ("--no-deps", "--require-hashes", "--requirement", str(_LOCK))
    command = (sys.executable, "-m", "pip", "download", "-qq", "--dest", str(folder))
    run(*command, *fits, *python, *locked)
