"""`make apt-repo`: a signed apt repository of packages, made by reprepro."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from bridge import __version__
from packages.deb import BUILT
from packages.shell import BUILDS, ROOT, base, copy_of, inside

REPOSITORY = ROOT / "build" / "apt"
_DISTRIBUTIONS = """\
Origin: wisco2mqtt
Label: wisco2mqtt
Codename: stable
Architectures: amd64 arm64 armhf
Components: main
Description: wisco2mqtt for Debian 12 and 13, and Raspberry Pi OS
SignWith: yes
"""
# The key lives in the system that is used up: whoever publishes signs with another.
_MAKE = """
export GNUPGHOME=/root/key
mkdir -m 700 $GNUPGHOME
gpg --batch --quiet --passphrase '' --quick-generate-key wisco2mqtt-trial default sign never
for package in /packages/*.deb; do reprepro -b /apt includedeb stable $package; done
gpg --batch --quiet --export > /apt/wisco2mqtt.gpg
gpgconf --kill all
rm -rf /apt/conf /apt/db
"""


def make_repository(packages: Sequence[Path], target: Path = REPOSITORY) -> Path:
    """Returns a folder that apt takes, with the public key in wisco2mqtt.gpg."""
    system = copy_of(base("bookworm", BUILDS), "repository")
    (system / "apt" / "conf").mkdir(parents=True)
    (system / "apt" / "conf" / "distributions").write_text(_DISTRIBUTIONS)
    (system / "packages").mkdir()
    for package in packages:
        shutil.copy(package, system / "packages")
    inside(system, _MAKE)
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(system / "apt", target)
    shutil.rmtree(system)
    return target


def main() -> int:
    """Makes it of the package that `make deb` built, and says where it is."""
    print(make_repository([BUILT / f"wisco2mqtt_{__version__}_all.deb"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
