"""`make image`: the image, built by buildah on a base of debootstrap, and run by podman (root)."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe

from bridge.model import DIO100, DO100
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.tcp import TcpEndpoint
from packages.deb import build_deb
from packages.shell import CACHE, ROOT, base, run

FOLDER = ROOT / "packaging" / "image"
IMAGE, BASE = "localhost/wisco2mqtt", "localhost/debian-base"
_INSIDE = "--inside"  # of a network of our own: the panel has its usual port there
_STORE = (f"--root={CACHE}/images", f"--runroot={CACHE}/images-run", "--storage-driver=vfs")
# Limits and runtime are those that a sandbox of today's builders allows.
PODMAN = ("podman", *_STORE, "--runtime=runc", "--cgroup-manager=cgroupfs")
LIMITS = ("--ulimit=nofile=1024:1024", "--ulimit=nproc=1000:1000")
# As compose.yaml has it.
_RUN = (
    *(*PODMAN, "run", "--detach", "--network=host", *LIMITS),
    *("--read-only", "--tmpfs=/tmp", "--cap-drop=all", "--security-opt=no-new-privileges"),
)
LINES = """\
lines:
  - id: main
    port: tcp://{host}:{port}
    baud: 9600
    protocol: wisco
    stations:
      - {{address: 1, model: DIO100, id: garage}}
      - {{address: 2, model: DO100, id: pumps}}
"""
GATEWAY_PORT, _STOPS_S = 4196, 15.0

wrong = 0


def check(good: bool, words: str) -> None:
    """Prints one line, and counts what is wrong."""
    global wrong  # noqa: PLW0603  # the one figure of this program
    wrong += not good
    print(f"  {'ok   ' if good else 'WRONG'} {words}", flush=True)


def build() -> None:
    """Builds the image of the commit."""
    for tool in ("buildah", "podman", "runc"):
        if shutil.which(tool) is None:
            raise SystemExit(f"this needs {tool} (Debian: apt-get install buildah podman runc)")
    package = build_deb("bookworm")
    container = buildah("from", "scratch")
    buildah("copy", "-q", container, str(base("trixie", ("ca-certificates",))), "/")
    buildah("commit", "-q", "--rm", container, BASE)
    built = (
        "bud",
        "-q",
        "--isolation=chroot",
        "--format=docker",
        "--layers=false",
        "--tag",
        IMAGE,
    )
    from_here = ("--build-arg", f"BASE={BASE}", "--file", str(FOLDER / "Dockerfile"))
    buildah(*built, *from_here, str(package.parent))


def buildah(*words: str) -> str:
    """Returns what it prints."""
    command, *rest = words
    return run("buildah", *_STORE, command, *rest).strip()


def podman(*words: str) -> subprocess.CompletedProcess[str]:
    """Returns how it ended."""
    return subprocess.run((*PODMAN, *words), capture_output=True, text=True, check=False)


def try_image() -> int:
    """Runs it as compose.yaml does, with a broker and simulated modules."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    endpoint = TcpEndpoint(GATEWAY_PORT)
    with TemporaryDirectory() as name, SimulatedLine("wisco", 9600, modules, endpoint=endpoint):
        folder = Path(name)
        broker = Mosquitto(folder / "broker")
        broker.start()
        try:
            with MqttProbe(broker.port, "wisco/#", "homeassistant/#") as probe:
                container = _start(folder, broker.port)
                try:
                    _look(container, probe, modules)
                finally:
                    podman("rm", "--force", "--time=0", container)
        finally:
            broker.stop()
    return 1 if wrong else 0


def _start(folder: Path, broker: int) -> str:
    config = folder / "config"
    shutil.copytree(FOLDER / "config", config)
    text = (config / "config.yaml").read_text()
    text = text.replace("host: mosquitto", f"host: 127.0.0.1\n  port: {broker}")
    (config / "config.yaml").write_text(
        text.replace("lines: []\n", LINES.format(host="127.0.0.1", port=GATEWAY_PORT))
    )
    run("chown", "-R", "10001", str(config))
    password = ("--env=WISCO_PANEL_PASSWORD=open sesame", f"--volume={config}:/config")
    return run(*_RUN, *password, IMAGE).strip()


def _look(container: str, probe: MqttProbe, modules: list[SimulatedModule]) -> None:
    began = time.monotonic()
    for station in ("garage", "pumps"):
        probe.wait_message(f"wisco/{station}/availability", "online")
    check(True, f"online after {time.monotonic() - began:.1f} s")
    announced = {one.topic for one in probe.seen if one.topic.startswith("homeassistant/device/")}
    check(len(announced) > len(modules), f"{len(announced)} devices announced")
    probe.publish("wisco/garage/do/1/set", "ON")
    probe.wait_message("wisco/garage/do/1", "ON")
    check(bool(modules[0].outputs & 1), "a lamp is switched ON")
    healthy = podman("healthcheck", "run", container)
    check(healthy.returncode == 0, f"its health check ends with {healthy.returncode}")
    _look_at_its_cage(container)
    stopping = time.monotonic()
    podman("stop", "--time=20", container)
    took = time.monotonic() - stopping
    (state,) = json.loads(podman("inspect", container).stdout)
    code = state["State"]["ExitCode"]
    check(code == 0 and took < _STOPS_S, f"it stops with {code} after {took:.1f} s")
    orders = modules[0].ordered.copy()
    probe.clear()
    podman("start", container)
    probe.wait_message("wisco/garage/do/1", "ON")
    same = modules[0].ordered == orders and modules[0].outputs & 1
    check(bool(same), "started again, it ordered nothing, and the lamp is ON as before")


def _look_at_its_cage(container: str) -> None:
    who = podman("exec", container, "id", "-u").stdout.strip()
    check(who == "10001", f"it runs as user {who}")
    for path in ("/x", "/usr/lib/wisco2mqtt/x", "/etc/x"):
        refused = podman("exec", "--user=0", container, "touch", path)
        check(
            "Read-only" in refused.stderr, f"{path}: {refused.stderr.strip().rpartition(': ')[2]}"
        )
    for path in ("/config/x", "/state/x", "/tmp/x"):  # noqa: S108  # of the container
        done = podman("exec", container, "touch", path)
        check(done.returncode == 0, f"{path} can be written")
    caps = podman("exec", container, "grep", "CapEff", "/proc/1/status").stdout.split()
    check(caps[-1:] == ["0000000000000000"], f"its capabilities: {caps[-1:]}")


def main(arguments: list[str]) -> int:
    """Returns 0 where nothing is wrong."""
    if _INSIDE in arguments:
        return try_image()
    build()
    size = sum(one["Size"] for one in json.loads(podman("inspect", IMAGE).stdout)) / 1e6
    print(f"{IMAGE}, {size:.0f} MB:")
    return in_a_network_of_its_own("packages.image", _INSIDE)


def in_a_network_of_its_own(*module: str) -> int:
    """Returns how a module with its arguments ended, where all ports are free."""
    alone = 'ip link set lo up && exec "$@"'
    again = (sys.executable, "-m", *module)
    done = subprocess.run(("unshare", "--net", "sh", "-c", alone, "sh", *again), check=False)
    return done.returncode


if __name__ == "__main__":
    os.umask(0o022)
    sys.exit(main(sys.argv[1:]))
