"""The messages to systemd, over real datagram sockets, and the unit file."""

import os
import re
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.daemon.app import LONGEST_STOP_S
from bridge.daemon.systemd import Notifier

UNIT = Path(__file__).parents[2] / "systemd" / "wisco2mqtt.service"


@pytest.fixture(params=["path", "abstract"])
def listener(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[socket.socket]:
    """Listens as systemd does, in the file system or under an abstract name."""
    abstract = f"\0wisco2mqtt-test-{os.getpid()}-{time.monotonic_ns()}"
    address = abstract if request.param == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as bound:
        bound.bind(address)
        bound.settimeout(5)
        yield bound


@pytest.fixture
def notifier(listener: socket.socket) -> Notifier:
    """Speaks to the listener."""
    name = listener.getsockname()
    address = f"@{name[1:].decode()}" if isinstance(name, bytes) else name
    return Notifier({"NOTIFY_SOCKET": address})


def test_ready_comes_with_a_status(notifier: Notifier, listener: socket.socket) -> None:
    """One datagram says that start-up is complete, and what there is."""
    notifier.ready("3 stations on 1 line")
    assert listener.recv(4096) == b"READY=1\nSTATUS=3 stations on 1 line"


def test_the_other_states(notifier: Notifier, listener: socket.socket) -> None:
    """Watchdog, stop and status are a datagram each, in order."""
    notifier.watchdog()
    notifier.status("all well")
    notifier.stopping()
    heard = [listener.recv(4096) for _ in range(3)]
    assert heard == [b"WATCHDOG=1", b"STATUS=all well", b"STOPPING=1"]


def test_reloading_carries_the_monotonic_time(notifier: Notifier, listener: socket.socket) -> None:
    """Systemd matches a reload with its own request by this time."""
    before = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    notifier.reloading()
    after = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    match = re.fullmatch(rb"RELOADING=1\nMONOTONIC_USEC=(\d+)", listener.recv(4096))
    assert match
    assert before <= int(match[1]) <= after


def test_a_status_cannot_smuggle_in_a_state(notifier: Notifier, listener: socket.socket) -> None:
    """A line break in a text, which may come from a device, starts no further assignment."""
    notifier.status("fine\nSTOPPING=1")
    assert listener.recv(4096) == b"STATUS=fine STOPPING=1"


@pytest.mark.parametrize("environ", [{}, {"NOTIFY_SOCKET": ""}])
def test_outside_of_systemd_nothing_happens(environ: dict[str, str]) -> None:
    """Without systemd nothing is sent, and that is no error."""
    Notifier(environ).ready("up")


@pytest.mark.parametrize("address", ["/nonexistent/notify", "relative", f"/{'x' * 200}", "@"])
def test_a_broken_socket_never_raises(address: str) -> None:
    """A broken socket never raises: a working bridge must not end because of it."""
    Notifier({"NOTIFY_SOCKET": address}).watchdog()


def test_a_full_queue_neither_blocks_nor_raises(
    notifier: Notifier, listener: socket.socket
) -> None:
    """A full queue neither blocks nor raises; earlier messages are still there."""
    for _ in range(2000):
        notifier.watchdog()
    assert listener.recv(4096) == b"WATCHDOG=1"


def test_the_watchdog_is_fed_at_half_its_time() -> None:
    """30 s of patience mean a sign of life every 15 s."""
    assert Notifier({"WATCHDOG_USEC": "30000000"}).watchdog_interval_s == 15.0
    own = {"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": str(os.getpid())}
    assert Notifier(own).watchdog_interval_s == 2.5


@pytest.mark.parametrize(
    "environ",
    [
        {},
        {"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"},
        {"WATCHDOG_USEC": "soon"},
        {"WATCHDOG_USEC": "0"},
        {"WATCHDOG_USEC": "-5"},
    ],
)
def test_no_watchdog_of_ours_means_no_interval(environ: dict[str, str]) -> None:
    """A watchdog time that is missing, wrong, or for another process gives no interval."""
    assert Notifier(environ).watchdog_interval_s is None


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unit with an executable that exists here, so that nothing but its own text counts."""
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze is not installed")
    text, count = re.subn(r"(?m)^ExecStart=\S+", "ExecStart=/bin/true", UNIT.read_text())
    assert count == 1
    path = tmp_path_factory.mktemp("unit") / UNIT.name
    path.write_text(text)
    return path


def analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs systemd-analyze without a pager."""
    return subprocess.run(
        ["systemd-analyze", "--no-pager", *arguments],
        check=False,
        capture_output=True,
        text=True,
        timeout=30,
    )


def test_systemd_finds_nothing_wrong_with_the_unit(unit: Path) -> None:
    """`systemd-analyze verify` has nothing to say, not even a warning."""
    done = analyze("verify", "--man=no", str(unit))
    about_us = [line for line in done.stderr.splitlines() if UNIT.stem in line]
    assert (done.returncode, about_us) == (0, [])


def test_the_unit_exposes_little(unit: Path) -> None:
    """The exposure that systemd works out for it stays at "OK" or better, and is printed."""
    done = analyze("security", "--offline=true", str(unit))
    verdict = done.stdout.splitlines()[-1]
    print(verdict)
    match = re.search(r"Overall exposure level for wisco2mqtt\.service: ([\d.]+)", verdict)
    assert match, done.stderr
    assert float(match[1]) <= 2.0


@pytest.mark.parametrize(
    "line",
    [
        "Type=notify",
        "NotifyAccess=main",
        "WatchdogSec=30",
        "Restart=on-failure",
        "RestartPreventExitStatus=78",
        "StartLimitIntervalSec=0",
        "DynamicUser=yes",
        "StateDirectory=wisco2mqtt",
        "ExecStart=/opt/wisco2mqtt/bin/wisco2mqtt run -c /etc/wisco2mqtt/config.yaml",
    ],
)
def test_the_unit_keeps_what_the_bridge_relies_on(line: str) -> None:
    """Each of these is a promise to the owner: a tidy-up must not lose one."""
    assert line in UNIT.read_text().splitlines()


@pytest.mark.parametrize(
    "kind",
    ["USB", "ACM", "CH343USB", "XRUSB", "AMA", "S", "SC", "mxc", "GS"],
)
def test_the_unit_lets_serial_ports_through(kind: str) -> None:
    """Adapters, ports on the board and those of hats: what is not named cannot be opened."""
    assert f"DeviceAllow=char-tty{kind} rw" in UNIT.read_text().splitlines()


@pytest.mark.parametrize("driver", ["usbserial", "cdc_acm"])
def test_an_adapter_may_come_after_the_service(driver: str) -> None:
    """The service lets through what is known at the start, so the drivers are loaded before it."""
    for key in ("Wants", "After"):
        assert re.search(rf"(?m)^{key}=.*\bmodprobe@{driver}\.service\b", UNIT.read_text())


def test_the_unit_gives_a_stop_the_time_that_it_takes_at_the_longest() -> None:
    """Killed before, it would leave a motor running that it was about to stop."""
    (given,) = re.findall(r"(?m)^TimeoutStopSec=(\d+)$", UNIT.read_text())
    assert float(given) > LONGEST_STOP_S + 5.0
