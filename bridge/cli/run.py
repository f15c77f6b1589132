"""`wisco2mqtt run`: the daemon."""

import argparse
import logging
import os
import signal
from pathlib import Path
from types import FrameType

from bridge import __version__
from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.cli.frame.locks import BaseTopicLocks, StartPorts
from bridge.cli.frame.signals import StopSignals
from bridge.clock import boot_s
from bridge.config.advice import advice_on
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config
from bridge.daemon.app import App, RunResult, Wanted
from bridge.daemon.heap import share_heap, trim_heap
from bridge.daemon.systemd import Notifier
from bridge.hub.memory import Memory

NAME = "run"
EXAMPLES = ("run -c config.yaml",)

_log = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no arguments but the common ones."""
    parser.description = (
        "Polls the modules, publishes what they say, and carries out commands, until SIGTERM or "
        "SIGINT. SIGHUP reads the configuration again: with a problem in it the bridge runs on "
        "as it is; without one the lines that it changes are started anew, and no others. A second "
        "bridge with the same base topic, or with a port that is in use, ends with a line that "
        "says so."
    )


def run(args: argparse.Namespace) -> int:
    """Run until a signal (return 0) or a failure (1); raise ConfigError for a wrong file."""
    path = find_config(args.config)
    config = load_config(path, os.environ)
    with BaseTopicLocks() as locks, StartPorts() as ports:
        locks.acquire(config.mqtt.base_topic)
        ports.acquire(config.lines)
        return _run(path, config, locks, ports)


def _run(path: Path, config: Config, locks: BaseTopicLocks, ports: StartPorts) -> int:
    share_heap()
    signals = RunSignals()
    signals.install()
    budgets, memory = Budgets(boot_s), Memory()
    log = BoundedLog(_log, boot_s, budgets)

    def load_again() -> Config:
        config = load_config(path, os.environ)
        locks.acquire(config.mqtt.base_topic)
        _advise(config, log)
        return config

    def make(config: Config) -> App:
        trim_heap()
        notifier = Notifier(os.environ)
        return App(
            config,
            notifier,
            load_again,
            memory,
            open_port=ports.open,
            budgets=budgets,
            config_path=path,
        )

    _advise(config, log)
    _tell_start(path, config)
    app = make(config)
    while (outcome := app.run(signals.poll)) is RunResult.RESTART:
        locks.keep(app.config.mqtt.base_topic)
        app = make(app.config)
    budgets.close()
    _log.info("stopped")
    return 0 if outcome is RunResult.STOPPED else 1


def _tell_start(path: Path, config: Config) -> None:
    lines = ", ".join(line.id for line in config.lines) or "none"
    _log.info("wisco2mqtt %s starts with %s; its lines: %s", __version__, path, lines)


def _advise(config: Config, log: BoundedLog) -> None:
    for advice in advice_on(config):
        log.tell(Cause.RELOAD, "advice", logging.WARNING, advice)


class RunSignals(StopSignals):
    """Handles SIGHUP as well as the signals that stop."""

    def __init__(self) -> None:
        super().__init__()
        self._reload = False

    def install(self) -> None:
        """Handle SIGTERM, SIGINT and SIGHUP."""
        super().install()
        signal.signal(signal.SIGHUP, self._on_reload)

    def poll(self) -> Wanted | None:
        """Return the outcome that a signal asked for, or None."""
        stop = super().poll()
        if stop is None and self._reload:
            self._reload = False
            return Wanted.RELOAD
        return stop

    def _on_reload(self, _number: int, _frame: FrameType | None) -> None:
        self._reload = True
