"""The app of Home Assistant as the Supervisor runs it: its folders, its start, its backup."""

import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import yaml
from support.listening import wait_until_it_listens
from support.mosquitto import Mosquitto, free_port
from support.supervisor import TOKEN, supervisor

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from panel.house import PASSWORD, WITH_PORT

ROOT = Path(__file__).parents[2]
USER, SECRET = "addons", "s3cret"
_APP = Path("packaging") / "home-assistant" / "wisco2mqtt"
_STARTS_S, _STOPS_S = 15.0, 15.0
# The start script, where the container's folders, ingress and port are those of this machine.
_START = """\
import sys
from pathlib import Path
sys.path.insert(0, {app!r})
import start
text = start._CONFIG.replace("172.30.32.2", "127.0.0.1").replace("8099", "{web}")
start._CONFIG = text
start.main(Path({data!r}), Path({config!r}), {supervisor!r})
"""


@dataclass
class Container:
    """The folders of the app, and what is around it."""

    folder: Path
    line: SimulatedLine
    supervisor: str
    web: int

    @property
    def data(self) -> Path:
        """Return what is /data in it."""
        return self.folder / "data"

    @property
    def config(self) -> Path:
        """Return the file of its configuration."""
        return self.folder / "config" / "config.yaml"

    @contextmanager
    def started(self, source: Path = ROOT) -> Iterator[None]:
        """Start it, as the Supervisor does, and stop it at the end; `source` is its image."""
        script = _START.format(
            app=str(source / _APP),
            web=self.web,
            data=str(self.data),
            config=str(self.config),
            supervisor=self.supervisor,
        )
        path = f"{self._program(source).parent}:{os.environ['PATH']}"
        environ = {**os.environ, "SUPERVISOR_TOKEN": TOKEN, "PATH": path}
        with subprocess.Popen((sys.executable, "-c", script), env=environ) as process:
            try:
                # The watchdog of the app looks for just that.
                wait_until_it_listens(self.web, _STARTS_S)
                yield
            finally:
                process.terminate()
                assert process.wait(_STOPS_S) == 0

    def restored(self, folder: Path) -> "Container":
        """Return another one, restored from a backup of this one while it runs."""
        archive = folder.with_suffix(".tar")
        exclude = yaml.safe_load((ROOT / _APP / "config.yaml").read_text())["backup_exclude"]
        with tarfile.open(archive, "w") as backup:
            for part in (self.data, self.config.parent):
                _add(backup, part, exclude)
        with tarfile.open(archive) as backup:
            backup.extractall(folder, filter="tar")
        return replace(self, folder=folder)

    def _program(self, source: Path) -> Path:
        program = self.folder / "bin" / "wisco2mqtt"
        program.parent.mkdir(exist_ok=True)
        code = f"import sys\nsys.path.insert(0, {str(source)!r})\n"
        program.write_text(f"#!{sys.executable}\n{code}{WITH_PORT.format(port=self.line.port)}")
        program.chmod(0o755)
        return program


def _add(backup: tarfile.TarFile, folder: Path, exclude: Sequence[str]) -> None:
    """Add a folder as the Supervisor does; a file that is gone meanwhile fails the backup.

    By `backup` in supervisor/apps/app.py, and `atomic_contents_add` of its library securetar.
    """
    backup.add(folder, arcname=folder.name, recursive=False)
    for path in folder.iterdir():
        if not any(PurePath(path).match(pattern) for pattern in exclude):
            assert path.is_file()
            backup.add(path, arcname=f"{folder.name}/{path.name}", recursive=False)


@contextmanager
def container(directory: Path) -> Iterator[tuple[Container, Mosquitto]]:
    """A container that was never started, with modules of which it knows nothing."""
    modules = [SimulatedModule(DIO100, 7), SimulatedModule(DO100, 12)]
    modules[0].set_mode(2, pulse=True, hold_s=0.5)
    broker = Mosquitto(directory / "broker", users={USER: SECRET})
    broker.start()
    told = {"host": "127.0.0.1", "port": broker.port, "username": USER, "password": SECRET}
    line = SimulatedLine(LineProtocol.MODBUS_RTU, 19200, modules)
    try:
        with line, supervisor(200, {"result": "ok", "data": {**told, "ssl": False}}) as url:
            app = Container(directory / "box", line, url, free_port())
            for folder in (app.data, app.config.parent):
                folder.mkdir(parents=True)
            options = {"panel_password": PASSWORD, "log_level": "info"}
            (app.data / "options.json").write_text(json.dumps(options))
            yield app, broker
    finally:
        broker.stop()
