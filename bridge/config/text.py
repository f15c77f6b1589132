"""The text of a value: as written, or from the environment (`!env`) or a file (`!file`)."""

import unicodedata
from collections.abc import Callable, Mapping
from pathlib import Path

from bridge.config.nodes import ENVIRONMENT_TAG, FILE_TAG, Place, WrongValueError, scalar
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
    return _located(place, text(place))


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


def credential(place: Place) -> str:
    """Read a user name or a password: text that is not empty and never shown."""
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


def _located(place: Place, written: str) -> Path:
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
        value = read_file(_located(place, written)).decode()
    except OSError as error:
        raise _unreadable(place, error) from error
    except UnicodeDecodeError:
        # Not chained: that error holds the bytes, which are a secret.
        raise WrongValueError(f"{place.shown} is not UTF-8 text; write it anew") from None
    # Editors and `echo` add a line break, which is not part of the secret.
    return value.removesuffix("\n").removesuffix("\r")


_ORIGINS: Mapping[str, Callable[[Place, str], str]] = {
    ENVIRONMENT_TAG: _environment,
    FILE_TAG: _file,
}
