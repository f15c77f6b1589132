"""The file of the configuration, as the panel shows and saves it: without its secrets."""

import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bridge.config.advice import advice_on
from bridge.config.load import config_of, read_text
from bridge.config.without_secrets import with_secrets, without_secrets
from bridge.errors import BridgeError, ConfigError
from bridge.files import read_file, replace_file

_COPY = ".before"


class StaleFileError(BridgeError):
    """The file is not the one any more that was shown: show it again."""


class ConfigFile:
    """Reads, checks and saves the file. Used by one thread at a time."""

    def __init__(self, path: Path, environ: Mapping[str, str]) -> None:
        self._path = path
        self._environ = environ
        # The version of a text must not help to guess the secrets in it.
        self._key = secrets.token_bytes(16)

    def show(self) -> dict[str, Any]:
        """Return its text without secrets, and the version to save it by.

        Raises:
            ConfigError: It cannot be read, or its secrets cannot be told from the rest.
        """
        text = read_text(self._path)
        shown = without_secrets(text, str(self._path))
        return {"file": str(self._path), "text": shown, "version": self._version(text)}

    def check(self, text: str) -> dict[str, Any]:
        """Return whether a text is valid, and every problem with its line and column."""
        try:
            config = config_of(self._whole(text), self._path, self._environ, secrets=False)
        except ConfigError as error:
            return {"valid": False, "problems": problems_of(error), "warnings": []}
        return {"valid": True, "problems": [], "warnings": list(advice_on(config))}

    def save(self, text: str, version: str) -> dict[str, Any]:
        """Keep a copy of the file, and replace it.

        Raises:
            ConfigError: The text is not valid.
            StaleFileError: The file changed since it was shown.
            OSError: It cannot be written.
        """
        before = read_text(self._path)
        if not hmac.compare_digest(self._version(before), version):
            raise StaleFileError("the file changed meanwhile: read it again, and repeat the change")
        whole = with_secrets(text, before, str(self._path))
        config_of(whole, self._path, self._environ)
        path = self._path.resolve()  # a link stays one
        mode = path.stat().st_mode & 0o777
        copy = path.with_name(path.name + _COPY)
        replace_file(copy, read_file(path), mode)
        replace_file(path, whole.encode(), mode)
        return {"file": str(self._path), "copy": str(copy), "version": self._version(whole)}

    def _whole(self, text: str) -> str:
        try:
            before = read_text(self._path)
        except ConfigError:
            return text
        return with_secrets(text, before, str(self._path))

    def _version(self, text: str) -> str:
        return hmac.new(self._key, text.encode(), hashlib.sha256).hexdigest()[:32]


def problems_of(error: ConfigError) -> list[dict[str, Any]]:
    """Return the problems as documents."""
    return [
        {"line": one.line, "column": one.column, "message": one.message} for one in error.problems
    ]


def config_file(path: Path | None) -> ConfigFile | None:
    """Return the file that the bridge was started with; None: it has none."""
    return None if path is None else ConfigFile(path, os.environ)
