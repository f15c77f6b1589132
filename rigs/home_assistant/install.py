"""`make test-ha` begins here: installs the releases that are not installed yet, once.

The old release comes from PyPI into a virtual environment, the new one into a Debian chroot of
its own, for the sake of its Python. What is missing for that is named, and nothing is skipped.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from home_assistant import former
from home_assistant.releases import RELEASES, Release

_BUILD_TOOLS = (
    "ca-certificates python3 python3-venv python3-pip python3-dev gcc g++ libc6-dev pkg-config"
)
# The integrations that a Home Assistant with nothing but MQTT and its own pages is made of.
_INTEGRATIONS = "mqtt api auth config device_automation http onboarding system_log websocket_api"
_DEBIAN_SOURCES = Path("/etc/apt/sources.list.d/debian.sources")
_MIRROR = "http://deb.debian.org/debian"


def main() -> int:
    """Installs what is not there; says what is missing for it."""
    missing = sorted({one for release in RELEASES for one in _missing(release)})
    for line in missing:
        print(f"make test-ha: {line}", file=sys.stderr)
    if missing:
        return 1
    for release in RELEASES:
        if not release.installed.exists():
            _install(release)
    former.install(former.FORMER)
    return 0


def _missing(release: Release) -> list[str]:
    """Return what this computer lacks, one line each."""
    found = []
    if shutil.which("chromium") is None:
        found.append("there is no chromium (Debian: apt-get install chromium)")
    if release.suite is None:
        if not (3, 11) <= sys.version_info < (3, 13):
            found.append(f"Home Assistant {release.version} needs Python 3.11 or 3.12")
        return found
    if os.geteuid() != 0:
        found.append(f"Home Assistant {release.version} runs in a chroot: this needs root")
    if not release.installed.exists() and shutil.which("debootstrap") is None:
        found.append("there is no debootstrap (Debian: apt-get install debootstrap)")
    return found


def _install(release: Release) -> None:
    began = time.monotonic()
    print(f"installing Home Assistant {release.version} in {release.root}", flush=True)
    shutil.rmtree(release.root, ignore_errors=True)  # one that was begun, and never finished
    release.root.parent.mkdir(parents=True, exist_ok=True)
    if release.suite is None:
        _run([sys.executable, "-m", "venv", str(release.root)])
    else:
        _make_chroot(release)
    _pip(release, f"homeassistant=={release.version}")
    constraints = _package(release) / "package_constraints.txt"
    wanted = [*_requirements(release), *release.pins]
    _pip(release, "--constraint", release.inside(constraints), *wanted)
    release.installed.touch()
    print(f"installed in {time.monotonic() - began:.0f} s", flush=True)


def _make_chroot(release: Release) -> None:
    tools = ",".join(_BUILD_TOOLS.split())
    variant = ["--variant=minbase", f"--include={tools}"]
    # Debian's script for its unstable branch knows every suite that is to come.
    target = [str(release.suite), str(release.root), _mirror(), "sid"]
    _run(["debootstrap", *variant, *target])
    for name in ("resolv.conf", "hosts"):
        shutil.copy(f"/etc/{name}", release.root / "etc" / name)
    certificates = Path("etc/ssl/certs/ca-certificates.crt")
    shutil.copy(Path("/") / certificates, release.root / certificates)
    _run(["chroot", str(release.root), "python3", "-m", "venv", "/opt/ha"])


def _mirror() -> str:
    """The mirror that apt uses on this computer."""
    sources = _DEBIAN_SOURCES.read_text() if _DEBIAN_SOURCES.exists() else ""
    found = re.search(r"^URIs: *(\S+)", sources, re.MULTILINE)
    return found[1] if found else _MIRROR


def _package(release: Release) -> Path:
    return next(release.venv.glob("lib/python3.*/site-packages/homeassistant"))


def _requirements(release: Release) -> list[str]:
    """Return the requirements of the integrations with which Home Assistant starts."""
    package = _package(release)
    bootstrap = (package / "bootstrap.py").read_text()
    [defaults] = re.findall(
        r"^DEFAULT_INTEGRATIONS = \{(.*?)^\}", bootstrap, re.DOTALL | re.MULTILINE
    )
    waiting = [*re.findall(r'"(\w+)"', defaults), *_INTEGRATIONS.split(), *release.extras]
    seen: set[str] = set()
    wanted: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            manifest = json.loads((package / "components" / name / "manifest.json").read_text())
            wanted.update(manifest.get("requirements", []))
            waiting += manifest.get("dependencies", [])
    return sorted(wanted)


def _pip(release: Release, *what: str) -> None:
    _run(release.command("python", "-m", "pip", "install", "--quiet", "--no-cache-dir", *what))


def _run(command: list[str]) -> None:
    # Its own words go to the terminal: only they tell what a mirror or a compiler disliked.
    if subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode != 0:
        sys.exit(f"make test-ha: this failed: {' '.join(command)}")


if __name__ == "__main__":
    sys.exit(main())
