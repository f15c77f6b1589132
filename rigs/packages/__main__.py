"""`make test-packages`: the Debian package and the wheel, from installation to purge."""

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from packages.deb import BUILT, build_deb
from packages.machine import Machine
from packages.repository import make_repository
from packages.shell import RUNS, base, copy_of, run
from packages.trial import Trial
from packages.wheel import try_wheel

RELEASES = ("bookworm", "trixie")
_BEFORE, _NOW = BUILT / "before", BUILT / "now"
_LINK = re.compile(r"\]\((?![a-z]+:|#)([^)#\s]+)")  # without the place within the page
_INSIDE = "--inside"  # of a network of our own: mosquitto has its usual port there

wrong = 0


def check(good: bool, words: str) -> None:  # what is checked, and in words
    """Prints one line, and counts what is wrong."""
    global wrong  # noqa: PLW0603  # the one figure of this program
    wrong += not good
    print(f"  {'ok   ' if good else 'WRONG'} {words}", flush=True)


def main(arguments: list[str]) -> int:
    """Returns 0 where nothing is wrong."""
    if _INSIDE in arguments:
        return _try_releases()
    began = time.monotonic()
    package = build_deb("bookworm")
    _look_into(package)
    make_repository([package], _NOW)
    make_repository([_package_before(package)], _BEFORE)
    print("the wheel, by pipx, on bookworm:")
    try_wheel(check)
    alone = 'ip link set lo up && exec "$@"'
    again = (sys.executable, "-m", "packages", _INSIDE)
    done = subprocess.run(("unshare", "--net", "sh", "-c", alone, "sh", *again), check=False)
    print(f"tried in {time.monotonic() - began:.0f} s")
    return 1 if wrong or done.returncode else 0


def _try_releases() -> int:
    for release in RELEASES:
        began = time.monotonic()
        root = copy_of(base(release, RUNS), f"machine-{release}")
        print(f"{release}:")
        Trial(Machine(root), check).run(_BEFORE, _NOW)
        shutil.rmtree(root)
        print(f"  {time.monotonic() - began:.0f} s")
    return 1 if wrong else 0


def _look_into(package: Path) -> None:
    """Any machine runs it: there is no machine code in it."""
    folder = BUILT / "content"
    shutil.rmtree(folder, ignore_errors=True)
    run("dpkg-deb", "-x", str(package), str(folder))
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    machine_code = [path for path in files if path.read_bytes().startswith(b"\x7fELF")]
    size = f"{package.stat().st_size / 1e6:.1f} MB, {len(files)} files"
    check(not machine_code, f"{package.name}: {size}, {len(machine_code)} of them ELF")
    links = [
        (page, link) for page in folder.rglob("*.md") for link in _LINK.findall(page.read_text())
    ]
    dead = [f"{page.name}: {link}" for page, link in links if not (page.parent / link).exists()]
    check(not dead, f"{len(links)} links within its pages, dead: {', '.join(dead) or 'none'}")


def _package_before(package: Path) -> Path:
    """The same as a release before it would be, until there is one."""
    folder = BUILT / "repacked"
    shutil.rmtree(folder, ignore_errors=True)
    run("dpkg-deb", "-R", str(package), str(folder))
    for path, key in (
        ("DEBIAN/control", "Version: "),
        ("usr/lib/wisco2mqtt/bridge/__init__.py", '__version__ = "'),
    ):
        text = (folder / path).read_text()
        (folder / path).write_text(text.replace(key, f"{key}0.0.", 1))
    target = BUILT / "wisco2mqtt_before_all.deb"
    run("dpkg-deb", "--root-owner-group", "-b", str(folder), str(target))
    return target


if __name__ == "__main__":
    os.umask(0o022)
    sys.exit(main(sys.argv[1:]))
