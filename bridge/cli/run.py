"""`wisco2mqtt run`: the daemon."""

import argparse
import logging
import os
import signal
from pathlib import Path
from types import FrameType

from bridge.app import App, Outcome
from bridge.cli.signals import StopSignals
from bridge.config.advice import advice_on
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config
from bridge.errors import ConfigError
from bridge.systemd import Notifier

NAME = "run"
HELP = "run the bridge"

_log = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Takes no arguments but the common ones."""
    parser.description = (
        "Polls the modules, publishes what they say, and carries out commands, until SIGTERM or "
        "SIGINT. SIGHUP reads the configuration again: with a problem in it the bridge runs on "
        "as it is; without one it starts anew with it, in the same process."
    )


def run(args: argparse.Namespace) -> int:
    """Runs until a signal (0) or a failure (1); a wrong configuration goes up as ConfigError."""
    path = find_config(args.config)
    config = load_config(path, os.environ)
    signals = _Signals(path, config)
    signals.install()
    while True:
        for advice in advice_on(signals.config):
            _log.warning("%s", advice)
        outcome = App(signals.config, Notifier(os.environ)).run(signals.poll)
        if outcome is not Outcome.RELOAD:
            return 0 if outcome is Outcome.STOPPED else 1


class _Signals(StopSignals):
    """SIGHUP besides those that stop.

    Attributes:
        config: The last configuration that was read without a problem.
    """

    def __init__(self, path: Path, config: Config) -> None:
        super().__init__()
        self.config = config
        self._path = path
        self._reload = False

    def install(self) -> None:
        """Takes over SIGTERM, SIGINT and SIGHUP."""
        super().install()
        signal.signal(signal.SIGHUP, self._on_reload)

    def poll(self) -> Outcome | None:
        """What is to be done now, if anything."""
        if self._reload:
            self._reload = False
            return super().poll() or self._reload_config()
        return super().poll()

    def _on_reload(self, _number: int, _frame: FrameType | None) -> None:
        self._reload = True

    def _reload_config(self) -> Outcome | None:
        try:
            config = load_config(self._path, os.environ)
        except ConfigError as error:
            for problem in error.problems:
                _log.error("%s", problem)
            _log.error("%s was not taken: the bridge runs on as it was", self._path)
            return None
        if config == self.config:
            _log.info("%s says what it said before: nothing to do", self._path)
            return None
        _log.info("%s changed: starting anew with it", self._path)
        self.config = config
        return Outcome.RELOAD
