"""Commands, the folders of this rig, and fresh Debian systems to run the commands in."""

import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wisco2mqtt" / "packages"
_MIRROR = "http://deb.debian.org/debian"
# What lies in a system besides Debian's smallest.
BUILDS = ("ca-certificates", "debhelper", "dh-python", "gnupg", "lintian", "python3", "reprepro")
RUNS = ("dbus", "mosquitto", "mosquitto-clients", "python3", "systemd", "systemd-sysv")
PIPX = ("ca-certificates", "pipx")


def run(*command: str, cwd: Path = ROOT) -> str:
    """Returns what a command prints; where it fails, shows it and ends."""
    done = subprocess.run(command, cwd=cwd, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        print(done.stdout)
        done.check_returncode()
    return done.stdout


def commit_epoch() -> str:
    """Returns the time of the commit that is built, for SOURCE_DATE_EPOCH."""
    return run("git", "log", "-1", "--format=%ct").strip()


def export(target: Path) -> None:
    """Puts the files of the commit into a new folder."""
    target.mkdir(parents=True)
    packed = subprocess.run(
        ("git", "archive", "HEAD"), cwd=ROOT, stdout=subprocess.PIPE, check=True
    )
    subprocess.run(("tar", "-x", "-C", str(target)), input=packed.stdout, check=True)


def base(release: str, packages: tuple[str, ...]) -> Path:
    """Returns the folder of a Debian with these packages; it is made at the first call.

    Raises:
        SystemExit: This machine cannot make one.
    """
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        raise SystemExit("this needs root and debootstrap (Debian: apt-get install debootstrap)")
    folder = CACHE / f"{release}-{'-'.join(packages)}"
    if not folder.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        print(f"making {folder}", flush=True)
        fresh = CACHE / f"{release}.new"
        shutil.rmtree(fresh, ignore_errors=True)
        run("debootstrap", "--variant=minbase", release, str(fresh), _MIRROR)
        _install(fresh, packages)
        fresh.rename(folder)
    return folder


def _install(system: Path, packages: tuple[str, ...]) -> None:
    shutil.copy("/etc/resolv.conf", system / "etc" / "resolv.conf")
    (system / "etc" / "hosts").write_text("127.0.0.1 localhost\n::1 localhost\n")
    policy = system / "usr" / "sbin" / "policy-rc.d"
    policy.write_text("#!/bin/sh\nexit 101\n")  # no service starts in a chroot
    policy.chmod(0o755)
    quietly = "DEBIAN_FRONTEND=noninteractive apt-get -qq -y --no-install-recommends install"
    inside(system, f"apt-get -qq update; {quietly} {' '.join(packages)} 2>&1; apt-get clean")
    policy.unlink()


def copy_of(system: Path, name: str) -> Path:
    """Returns a fresh copy of a system, to be used up."""
    target = CACHE / name
    shutil.rmtree(target, ignore_errors=True)
    run("cp", "-a", "--reflink=auto", str(system), str(target))
    return target


def inside(system: Path, script: str) -> str:
    """Returns what a script prints in a system; nothing stays mounted."""
    mounts = 'mount -t proc proc "$0/proc" && exec chroot "$0" sh -ec "$1"'
    return run("unshare", "--mount", "sh", "-c", mounts, str(system), f"export LC_ALL=C\n{script}")
