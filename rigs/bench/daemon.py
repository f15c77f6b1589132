"""The bridge's own process, and what it takes of the computer."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

_STOP_S = 20.0


class MeasuredDaemon:
    """`python -m bridge run`. Use it with `with`."""

    def __init__(self, config: Path) -> None:
        self._config = config
        self._log = config.with_suffix(".log")
        self.started_at = 0.0
        self._process: subprocess.Popen[bytes] | None = None
        self._cpu_s = self._cpu_at = 0.0

    def __enter__(self) -> Self:
        command = [sys.executable, "-m", "bridge", "run", "-c", str(self._config)]
        # An installed program has its byte code: compiling would take time and memory of its own.
        environ = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        self.started_at = time.monotonic()
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(command, env=environ, stderr=log)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            print(self._log.read_text(errors="replace"), file=sys.stderr)
        assert self._process is not None
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(_STOP_S)

    def begin(self) -> None:
        """The processor time is counted from here on."""
        self._cpu_s, self._cpu_at = self._cpu(), time.monotonic()

    def cpu_percent(self) -> float:
        """Return the CPU time since `begin`, in percent of one processor."""
        return round(100 * (self._cpu() - self._cpu_s) / (time.monotonic() - self._cpu_at), 1)

    def rss_mb(self) -> float:
        """Return the present memory of the process, in MB (10^6 bytes)."""
        for line in (self._proc() / "status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return round(int(line.split()[1]) * 1024 / 1e6, 1)
        raise LookupError("no VmRSS")

    def _cpu(self) -> float:
        fields = (self._proc() / "stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _proc(self) -> Path:
        assert self._process is not None
        return Path(f"/proc/{self._process.pid}")
