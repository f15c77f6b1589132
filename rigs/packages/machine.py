"""A Debian with a real systemd, in namespaces; its network is that of this process."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

_BOOT = Path(__file__).with_name("boot.sh")
_OWN = ("--mount", "--pid", "--cgroup", "--ipc", "--uts", "--fork", "--kill-child")
_BOOT_S, _HALT_S, _PAUSE_S = 60.0, 20.0, 0.1
_HALT = signal.SIGRTMIN + 4  # systemd(1): poweroff.target
# Of a tree that changes by itself, and of packages that are not ours.
_NOT_OURS = ("/.old", "/var/cache/", "/var/log/", "/var/lib/apt/", "/var/lib/mosquitto/")


class Machine:
    """Booted within `with`. Its processes end with it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._group = _group_root() / f"wisco2mqtt-packages-{os.getpid()}"
        self._unshare: subprocess.Popen[bytes] | None = None
        self._init = 0

    def __enter__(self) -> Self:
        self._group.mkdir()
        command = ("unshare", *_OWN, "--propagation", "private", "bash", str(_BOOT), str(self.root))
        # systemd wants a control group of its own, and this one is its root.
        joining = ("sh", "-c", 'echo $$ >"$0/cgroup.procs"; exec "$@"', str(self._group), *command)
        self._unshare = subprocess.Popen(joining, stdout=subprocess.DEVNULL)
        self._wait_for_boot()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with suppress(ProcessLookupError):
            os.kill(self._init, _HALT)
        if self._unshare is not None:
            try:
                self._unshare.wait(_HALT_S)
            except subprocess.TimeoutExpired:
                self._unshare.kill()
                self._unshare.wait()
        self._remove_groups()

    def run(self, script: str, *, expect: int | None = 0) -> str:
        """Returns what a script prints; `expect` is its exit status, None any."""
        enter = ("nsenter", "-t", str(self._init), "-m", "-p", "-i", "-u", "-C", "-r", "-w")
        clean = ("env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "HOME=/root", "LC_ALL=C.UTF-8")
        done = subprocess.run(
            (*enter, *clean, "DEBIAN_FRONTEND=noninteractive", "sh", "-c", script),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            check=False,
        )
        if expect is not None and done.returncode != expect:
            raise AssertionError(f"{script} ended with {done.returncode}: {done.stdout}")
        return done.stdout

    def shown(self, unit: str, key: str) -> str:
        """Returns a property of a unit."""
        return self.run(f"systemctl show --value -p {key} {unit}").strip()

    def files(self) -> set[str]:
        """Returns every path on its disk that could be of a package."""
        found = self.run("find / -xdev -path /proc -prune -o -print").splitlines()
        return {path for path in found if not path.startswith(_NOT_OURS)}

    def _wait_for_boot(self) -> None:
        until = time.monotonic() + _BOOT_S
        while time.monotonic() < until:
            time.sleep(_PAUSE_S)
            self._init = self._init or self._find_init()
            if self._init and "running" in self._state():
                return
        raise AssertionError(f"{self.root} does not boot: {self._state()}")

    def _state(self) -> str:
        state = self.run("systemctl is-system-running 2>&1", expect=None)
        return state.replace("degraded", "running")  # as far as a container can

    def _find_init(self) -> int:
        assert self._unshare is not None
        pid = self._unshare.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        if not children:
            return 0
        is_systemd = Path(f"/proc/{children[0]}/comm").read_text().strip() == "systemd"
        return int(children[0]) if is_systemd else 0

    def _remove_groups(self) -> None:
        for folder, _, _ in os.walk(self._group, topdown=False):
            with suppress(OSError):
                Path(folder).rmdir()


def _group_root() -> Path:
    """Returns where this machine has control groups of version 2."""
    mounts = (line.split() for line in Path("/proc/self/mounts").read_text().splitlines())
    return next(Path(mount[1]) for mount in mounts if mount[2] == "cgroup2")
