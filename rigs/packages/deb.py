"""`make deb`: the Debian package of the commit, built in a fresh Debian."""

import argparse
import email.utils
import shutil
import sys
from pathlib import Path

from bridge import __version__
from packages.shell import BUILDS, ROOT, base, commit_epoch, copy_of, export, inside, run

BUILT = ROOT / "build" / "deb"
_LOCK = ROOT / "requirements" / "debian.txt"
_CHANGELOG = """\
wisco2mqtt ({version}) unstable; urgency=medium

  * See CHANGELOG.md.

 -- {maintainer}  {date}
"""
# Not checked (-d): that there is a compiler, which it does not need.
_BUILD = """
cd /build/wisco2mqtt
dpkg-buildpackage -d --build=binary --unsigned-source --unsigned-changes >/build/log 2>&1 || {
  tail -n 40 /build/log; exit 1; }
lintian --fail-on error,warning --display-info --tag-display-limit 0 --allow-root /build/*.changes
"""


def build_deb(release: str, version: str = __version__) -> Path:
    """Returns the package; what lintian says is printed."""
    system = copy_of(base(release, BUILDS), f"build-{release}")
    source = system / "build" / "wisco2mqtt"
    export(source)
    shutil.copytree(ROOT / "packaging" / "debian", source / "debian", dirs_exist_ok=True)
    (source / "debian" / "changelog").write_text(_changelog(source, version))
    _download(source / "wheels")
    print(inside(system, _BUILD), end="")
    (built,) = (system / "build").glob("*.deb")
    BUILT.mkdir(parents=True, exist_ok=True)
    target = BUILT / built.name
    shutil.copy(built, target)
    shutil.rmtree(system)
    return target


def _changelog(source: Path, version: str) -> str:
    control = (source / "debian" / "control").read_text()
    (maintainer,) = (
        line.removeprefix("Maintainer: ")
        for line in control.splitlines()
        if line.startswith("Maintainer: ")
    )
    date = email.utils.formatdate(int(commit_epoch()))
    return _CHANGELOG.format(version=version, maintainer=maintainer, date=date)


def _download(folder: Path) -> None:
    """Fetches the locked wheels: the build itself needs no network."""
    # Of a wheel with machine code only the Python is packaged, so one for any machine will do.
    fits = ("--platform", "manylinux2014_x86_64", "--platform", "any")
    python = ("--python-version", "3.11", "--implementation", "cp", "--only-binary", ":all:")
    locked = ("--no-deps", "--require-hashes", "--requirement", str(_LOCK))
    command = (sys.executable, "-m", "pip", "download", "-qq", "--dest", str(folder))
    run(*command, *fits, *python, *locked)


def main() -> int:
    """Builds it, and says where it is."""
    parser = argparse.ArgumentParser(prog="deb")
    parser.add_argument("--release", default="bookworm")
    parser.add_argument("--version", default=__version__)
    options = parser.parse_args()
    print(build_deb(options.release, options.version))
    return 0


if __name__ == "__main__":
    sys.exit(main())
