"""The text of a value: as written, or from the environment (`!env`) or a file (`!file`)."""

import unicodedata
from collections.abc import Callable, Mapping
from pathlib import Path

from bridge.config.credentials import is_credential, source_of
from bridge.config.nodes import ENVIRONMENT_TAG, FILE_TAG, Place, WrongValueError, scalar
from bridge.config.shapes import either, shaped
from bridge.files import read_file

# Long enough for a token as password; the limit of MQTT is 65535 bytes.
MAX_CHARACTERS = 8192
MAX_LABEL_CHARACTERS = 120

# Control characters break lines of a log; surrogates cannot be encoded in UTF-8.
_REFUSED_CATEGORIES = {"Cc", "Cs"}


def text(place: Place) -> str:
    """Read text. Messages never show what `!env` or `!file` returned."""
    node = scalar(place, tags=_ORIGINS)
    _check_characters(node.value)
    if node.tag not in _ORIGINS:
        return str(node.value)
    value = _ORIGINS[node.tag](place, node.value)
    _check_characters(value)
    return value


def file_path(place: Place) -> Path:
    """Read a path; a relative path starts at the folder of the configuration file."""
    return located(place, text(place))


def home_folder(place: Place) -> Path:
    """Return the folder that `~` stands for."""
    try:
        return Path(place.source.environ.get("HOME") or Path.home())
    except RuntimeError as error:
        raise WrongValueError("there is no home folder; write an absolute path") from error


def readable_file(place: Place) -> Path:
    """Read the path of a file that must exist and be readable now."""
    path = file_path(place)
    try:
        read_file(path)
    except OSError as error:
        raise _unreadable(place, error) from error
    return path


def secret_file(place: Place) -> Path:
    """Read the path of a file that must be readable where secrets are read."""
    return readable_file(place) if place.source.secrets else file_path(place)


def credential(place: Place) -> str:
    """Read a user name or a password: any text that is not empty, never shown.

    Where secrets are not read, what `!env` or `!file` leads to is not looked at.
    """
    node = scalar(place, tags=_ORIGINS)
    if node.tag in _ORIGINS and not place.source.secrets:
        _check_characters(node.value)
        return ""
    value = text(place)
    if not value:
        raise WrongValueError("is empty; write one, or take the key out")
    return value


def label(place: Place) -> str:
    """Read a name for people, in any language."""
    value = text(place)
    if not value.strip() or len(value) > MAX_LABEL_CHARACTERS:
        raise WrongValueError(
            f"{place.shown} is empty or too long; write 1 to {MAX_LABEL_CHARACTERS} characters"
        )
    return value


def located(place: Place, written: str) -> Path:
    """Return where a path leads: a relative one starts at the folder of the configuration file."""
    if written.startswith("~/"):
        return home_folder(place) / written.removeprefix("~/")
    return place.source.path.parent.absolute() / written


def _unreadable(place: Place, error: OSError) -> WrongValueError:
    advice = "check the path and its permissions"
    return WrongValueError(f"{place.shown} cannot be read ({error.strerror}); {advice}")


def _check_characters(value: str) -> None:
    if len(value) > MAX_CHARACTERS:
        raise WrongValueError(f"is longer than {MAX_CHARACTERS} characters; shorten it")
    for position, character in enumerate(value, start=1):
        if unicodedata.category(character) in _REFUSED_CATEGORIES:
            code = f"U+{ord(character):04X}"
            raise WrongValueError(f"has the control character {code} at {position}; remove it")


def _environment(place: Place, name: str) -> str:
    value = place.source.environ.get(name)
    if not value:
        what = "is not set" if value is None else "is empty"
        raise WrongValueError(f"{place.shown} names a variable that {what}; set it for the service")
    return value


def _file(place: Place, written: str) -> str:
    try:
        value = _content(place, located(place, written)).decode()
    except UnicodeDecodeError:
        # Not chained: that error holds the bytes, which are a secret.
        raise WrongValueError(f"{place.shown} is not UTF-8 text; write it anew") from None
    # Editors and `echo` add a line break, which is not part of the secret.
    return value.removesuffix("\n").removesuffix("\r")


def _content(place: Place, path: Path) -> bytes:
    """Read a file; a credential of systemd that is not there, from where the unit takes it."""
    try:
        return read_file(path)
    except OSError as error:
        if not is_credential(path):
            raise _unreadable(place, error) from error
        missing = f"{place.shown} cannot be read ({error.strerror})"
    source = source_of(path)
    if source is None:
        raise WrongValueError(
            f"{missing}: it is there only while the service runs, and no unit says what it is a "
            "copy of; name a file that you may read"
        )
    try:
        return read_file(source)
    except OSError as error:
        raise WrongValueError(
            f"{missing}, and its source {source} cannot be read either ({error.strerror}); "
            "run this as root, with sudo"
        ) from error


_ORIGINS: Mapping[str, Callable[[Place, str], str]] = {
    ENVIRONMENT_TAG: _environment,
    FILE_TAG: _file,
}


# What stands elsewhere is text to an editor too. Text that looks like a number needs no quotes.
TEXT = either({"type": "string", "minLength": 1}, {"type": ["number", "boolean"]})
for _reader in (text, file_path, readable_file, secret_file, credential, label):
    shaped(_reader, TEXT)
