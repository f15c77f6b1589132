"""Operation: E1 a thread that is stuck, E2 a start with neither adapter nor broker."""

import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import free_port
from support.panel import broker, panel, write_config

from bridge.model import LineProtocol
from proofs import frozen_daemon
from proofs.figures import Figure, Run, Scale, proof
from proofs.systemd_socket import systemd_socket

# --- E1 ---------------------------------------------------------------------------------------

RESTART_LATER_S = 5.0
CAUSES = {
    "line": "the thread of line main is stuck",
    "mqtt": "the MQTT thread is stuck",
    "main": "",  # systemd says it: no thread of ours is left that could
}


@dataclass(frozen=True, slots=True)
class _Watch:
    """The times that systemd waits for the watchdog, and the bridge for its threads."""

    watchdog_s: float
    stuck_s: str  # `-`: the bridge's own limit

    @property
    def within_s(self) -> float:
        """Return how soon after a thread froze systemd has to restart the bridge."""
        return self.watchdog_s + RESTART_LATER_S


def _restarted_after_s(thread: str, watch: _Watch, directory: Path) -> float | None:
    """Freezes one thread; returns when systemd would start the bridge anew. None: never."""
    directory.mkdir()
    program = (str(Path(frozen_daemon.__file__).resolve()), thread, watch.stuck_s)
    environ = {"WATCHDOG_USEC": str(round(watch.watchdog_s * 1e6))}
    with (
        panel(LineProtocol.MODBUS_RTU) as line,
        broker(directory) as mosquitto,
        systemd_socket(directory) as notify,
        Daemon(
            write_config(directory, line, mosquitto.port),
            notify=notify,
            program=program,
            environ=environ,
        ) as daemon,
    ):
        daemon.wait_for_log("connected to the broker")
        daemon.wait_for_log("online: DO100")
        began = fed_at = time.monotonic()
        daemon.signal(signal.SIGUSR1)
        notify.settimeout(0.05)
        while time.monotonic() < fed_at + watch.watchdog_s and daemon.process.poll() is None:
            if _hears_watchdog(notify):
                fed_at = time.monotonic()
            if fed_at > began + watch.within_s:
                return None  # fed on and on
        ended = daemon.process.poll()
        if ended is not None:
            named = CAUSES[thread] and CAUSES[thread] in daemon.log
            return time.monotonic() - began if ended == 1 and named else None
        # systemd kills it now; only the main thread cannot say itself what is wrong.
        return fed_at + watch.watchdog_s - began if thread == "main" else None


def _hears_watchdog(notify: socket.socket) -> bool:
    try:
        return b"WATCHDOG=1" in notify.recv(4096)
    except TimeoutError:
        return False


@proof("E1")
def a_thread_is_stuck(run: Run) -> Figure:
    """Whichever it is, systemd starts the bridge anew, and the log names the cause."""
    # In short, both limits are: those of the unit and of the bridge would take half a minute.
    watch = _Watch(6.0, "2") if run.scale is Scale.SHORT else _Watch(30.0, "-")
    with ThreadPoolExecutor(len(CAUSES)) as pool:
        seen = {
            thread: pool.submit(_restarted_after_s, thread, watch, run.directory / thread)
            for thread in CAUSES
        }
        after_s = {thread: future.result() for thread, future in seen.items()}
    return Figure(
        injected=f"frozen: {', '.join(CAUSES)}; WatchdogSec {watch.watchdog_s:.0f}",
        seen="anew after "
        + ", ".join("never" if s is None else f"{s:.1f} s" for s in after_s.values()),
        promised=f"anew within {watch.within_s:.0f} s, cause named",
        kept=all(s is not None and s <= watch.within_s for s in after_s.values()),
    )


# --- E2 ---------------------------------------------------------------------------------------

READY_WITHIN_S = 5.0
STAYS_S = 2.0
PORTS = ("/dev/serial/by-id/usb-nobody", "tcp://127.0.0.1:{port}", "rfc2217://127.0.0.1:{port}")


def _boot(directory: Path, port: str) -> tuple[float, bool]:
    """Starts the daemon where nothing is there; returns the seconds to READY, and if it stays."""
    directory.mkdir()
    config = directory / "config.yaml"
    config.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {free_port()}}}\nstate_dir: {directory}\n"
        f"lines:\n  - id: main\n    port: {port.format(port=free_port())}\n    baud: 9600\n"
        "    protocol: wisco\n    stations: [{address: 1, model: DIO100}]\n"
    )
    with systemd_socket(directory) as notify:
        began = time.monotonic()
        with Daemon(config, notify=notify) as daemon:
            assert b"READY=1" in notify.recv(4096)
            ready_s = time.monotonic() - began
            daemon.wait_for_log("line main: ")
            daemon.wait_for_log("no connection to the broker")
            time.sleep(STAYS_S)  # what would end it has its time
            stays = daemon.process.poll() is None
            status, _ = daemon.stop()
    return ready_s, stays and status == 0


@proof("E2")
def neither_adapter_nor_broker_is_there(run: Run) -> Figure:
    """Both may come later: the bridge is up, and waits."""
    count = run.scale.of(1, 4)
    boots = [
        _boot(run.directory / f"{kind}{n}", port)
        for n in range(count)
        for kind, port in enumerate(PORTS[: run.scale.of(1, len(PORTS))])
    ]
    slowest_s = max(ready_s for ready_s, _ in boots)
    stayed = sum(stays for _, stays in boots)
    return Figure(
        injected=f"{len(boots)} starts without adapter and broker",
        seen=f"READY within {slowest_s:.2f} s, {stayed} stayed up",
        promised=f"READY within {READY_WITHIN_S:.0f} s, all stay",
        kept=slowest_s <= READY_WITHIN_S and stayed == len(boots),
    )
