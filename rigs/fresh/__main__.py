"""`make test-fresh`: every line of README and docs in a fresh bookworm, from the clone on."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fresh.shims import JOURNALCTL, NANO, POLICY, SYSTEMCTL

ROOT = Path(__file__).parents[2]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wisco2mqtt" / "fresh"
BASE, MACHINE = CACHE / "bookworm", CACHE / "machine"
PAGES = ("topics.md", "broker/README.md", "commission.md", "simulator.md", "troubleshooting.md")
PORT = "/dev/ttyUSB0"
BROKER = "install -d -o mosquitto /run/mosquitto; mosquitto -d -c /etc/mosquitto/mosquitto.conf"
CLONE = "/home/pi/wisco2mqtt"

# What such an exit status means: not found, wrong usage, wrong configuration. Such a line cannot
# be pasted as it stands; one that ends otherwise did what it says, or said what is missing.
UNFIT = {2, 78, 126, 127}
ENDLESS = re.compile(r" (watch|monitor|simulate|demo)\b|--watch|mosquitto_sub|journalctl")
LOOK_S, DEMO_S = 8, 120  # the demo first installs what it needs
# The lines are those of one terminal: a `cd` holds for what comes after it.
_KEEPS_ITS_FOLDER = 'cd "$(cat ~/.folder)"; {typed}\nstatus=$?; pwd > ~/.folder; exit $status'
# A line with one of these is left out, and why.
LEFT_OUT = {
    "make test": "it takes long, and is what runs elsewhere",
    "10.0.0.5": "an address of the reader's",
    "-h broker.home": "a name of the reader's",
    "git pull": "the clone here has no upstream",
    "--for 60min": "an hour",
    "--for 10min": "ten minutes",
}


@dataclass(frozen=True, slots=True)
class Pasted:
    """One line, and how it ended."""

    page: str
    line: str
    status: int
    took_s: float
    said: str


def main() -> int:
    """Returns 0 where every line can be pasted, and entities are on the broker in the end."""
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        print("this needs root and debootstrap (Debian: apt-get install debootstrap)")
        return 1
    began = time.monotonic()
    _make_machine()
    print(f"a fresh bookworm, made in {time.monotonic() - began:.0f} s", flush=True)
    began = time.monotonic()
    pasted = list(_paste_all())
    unfit = [one for one in pasted if one.status in UNFIT]
    for one in unfit:
        print(f"cannot be pasted: {one.page}: {one.line}\n  {one.status}: {one.said}")
    print(f"{len(pasted)} lines pasted in {time.monotonic() - began:.0f} s; {len(unfit)} unfit")
    return 1 if unfit else 0


def _make_machine() -> None:
    if not (BASE / "usr/bin/sudo").exists():
        BASE.parent.mkdir(parents=True, exist_ok=True)
        # What Raspberry Pi OS has besides: sudo, git, make, Python, nano, completion of bash.
        more = "--include=ca-certificates,sudo,git,make,python3-venv,openssl,bash-completion"
        _run("debootstrap", "--variant=minbase", more, "bookworm", str(BASE))
    shutil.rmtree(MACHINE, ignore_errors=True)
    _run("cp", "-a", str(BASE), str(MACHINE))
    for name in ("etc/resolv.conf", "etc/hosts", "etc/ssl/certs/ca-certificates.crt"):
        shutil.copy(Path("/") / name, MACHINE / name)
    for path, text in {
        "usr/bin/systemctl": SYSTEMCTL,
        "usr/bin/journalctl": JOURNALCTL,
        "usr/bin/nano": NANO,
        "usr/sbin/policy-rc.d": POLICY,
    }.items():
        (MACHINE / path).write_text(text)
        (MACHINE / path).chmod(0o755)
    (MACHINE / "root/pasted.yaml").write_text(_smallest_configuration())
    _inside("useradd -m -G dialout,sudo -s /bin/bash pi", user="root")
    (MACHINE / "etc/sudoers.d/pi").write_text("pi ALL=(ALL) NOPASSWD: ALL\n")
    files = _run("git", "-C", str(ROOT), "archive", "--format=tar", "HEAD")
    (MACHINE / CLONE.removeprefix("/")).mkdir()
    subprocess.run(["tar", "-x", "-C", str(MACHINE) + CLONE], input=files, check=True)
    (MACHINE / "home/pi/.folder").write_text(f"{CLONE}\n")
    _inside("chown -R pi: /home/pi", user="root")


def _smallest_configuration() -> str:
    """The one that README shows, with the port of this machine and one module more."""
    (text,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    text = re.sub(r"^   ", "", text, flags=re.MULTILINE)
    text = re.sub(r"port: /dev/\S+", f"port: {PORT}", text)
    return f"{text}      - {{address: 2, model: DO100, id: pumps, covers: {{shutter: {{open: 6, close: 7, open_time: 1s, close_time: 1s}}}}}}\n"  # noqa: E501  # one line of YAML


def _paste_all() -> Iterator[Pasted]:
    """README up to the service; the pages of docs; then the removal."""
    readme = list(_lines(ROOT / "README.md"))
    first = next(n for n, line in enumerate(readme) if "disable --now" in line)
    last = next(n for n, line in enumerate(readme) if n > first and "daemon-reload" in line)
    panel = None
    for line in (*readme[:first], *readme[last + 1 :]):
        yield _paste("README.md", line)
        if "ln -sf" in line:  # the modules are wired from now on
            panel = _panel()
            _inside(BROKER, user="root")
    yield _paste("README.md", "timeout 20 mosquitto_sub -t 'homeassistant/#' -C 3 -F '%t'")
    for page in PAGES:
        if page == "commission.md":
            yield _paste(page, "sudo systemctl stop wisco2mqtt")
            yield _paste(page, "cp /etc/wisco2mqtt/config.yaml config.yaml")
        for line in _lines(ROOT / "docs" / page):
            yield _paste(f"docs/{page}", line)
    for line in readme[first : last + 1]:
        yield _paste("README.md", line)
    if panel is not None:
        panel.terminate()


def _lines(path: Path) -> Iterator[str]:
    """What stands in blocks of shell; a block with functions or continued lines is one."""
    text = path.read_text()
    for indent, block in re.findall(r"^( *)```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
        lines = [line.removeprefix(indent) for line in block.splitlines()]
        if any(line.endswith(("\\", "{")) for line in lines):
            yield "\n".join(lines)
        else:
            yield from (line for line in lines if line and not line.startswith("#"))


def _panel() -> "subprocess.Popen[bytes]":
    """The modules at the port, and a second adapter that listens."""
    line = (
        "wisco2mqtt simulate --module DIO100@1 --module DO100@2 "
        f"--pty {PORT} --tap /dev/ttyUSB1 </dev/null"
    )
    process = subprocess.Popen(_chroot(f"umask 0; exec {line}", "root"), stdout=subprocess.DEVNULL)
    time.sleep(3)
    _inside("chmod 666 /dev/pts/* 2>/dev/null; true", user="root")
    return process


def _paste(page: str, line: str) -> Pasted:
    if reason := next((why for word, why in LEFT_OUT.items() if word in line), None):
        print(f"      -  {page}: {line.splitlines()[0]}  (left out: {reason})", flush=True)
        return Pasted(page, line, 0, 0.0, reason)
    began = time.monotonic()
    word = line.split(" #", maxsplit=1)[0].strip()
    # A person presses Ctrl-C where it goes on, and says yes where it asks.
    look_s = DEMO_S if "demo" in word else LOOK_S
    typed = f"timeout -s INT {look_s} {word}" if ENDLESS.search(f" {word}") else line
    with _person() as keyboard:
        ended = subprocess.run(
            _chroot(_KEEPS_ITS_FOLDER.format(typed=typed), "pi"),
            stdin=keyboard,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
    said = ended.stdout.decode(errors="replace").strip()
    took_s = time.monotonic() - began
    print(f"{ended.returncode:3} {took_s:5.1f} s  {page}: {line.splitlines()[0]}", flush=True)
    for told in said.splitlines()[-2:]:
        print(f"             {told[:150]}", flush=True)
    return Pasted(page, line, ended.returncode, took_s, said[-300:])


@contextmanager
def _person() -> Iterator[int]:
    """Yields a terminal at which somebody has typed yes, twice."""
    person, terminal = os.openpty()
    os.write(person, b"y\ny\n")
    try:
        yield terminal
    finally:
        os.close(terminal)
        os.close(person)


def _chroot(script: str, user: str) -> list[str]:
    """Runs as the user at a terminal would; nothing stays mounted."""
    mounts = (
        'mount -t proc proc "$0/proc" && mount --bind /dev/pts "$0/dev/pts" && '
        'exec chroot "$0" su - "$1" -c "$2"'
    )
    return ["unshare", "--mount", "sh", "-c", mounts, str(MACHINE), user, script]


def _inside(script: str, *, user: str) -> None:
    subprocess.run(_chroot(script, user), check=True, stdout=subprocess.DEVNULL)


def _run(*command: str) -> bytes:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout


if __name__ == "__main__":
    sys.exit(main())
