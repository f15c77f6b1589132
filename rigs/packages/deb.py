"""`make deb`: the Debian package of the commit, built in a fresh Debian."""

import argparse
import email.utils
import shutil
import sys
from pathlib import Path

from bridge import __version__
from packages.shell import BUILDS, ROOT, base, commit_epoch, copy_of, export, inside
from packages.wheel import fetch_wheels

BUILT = ROOT / "build" / "deb"
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
    fetch_wheels(source / "wheels")
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
