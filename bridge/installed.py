"""How this program was installed, and so how a library that it lacks is added to it."""

import os
import shlex
import sys
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path

_DISTRIBUTION = "wisco2mqtt"
_DEBIAN = Path("/usr/lib/wisco2mqtt")


def how_to_add(library: str) -> str:
    """Return what to do to add a library of an extra to this very installation."""
    if Path(__file__).is_relative_to(_DEBIAN):
        return "the Debian package does not contain it; an installation by pip or pipx can"
    wanted = shlex.quote(_requirement(library))
    if "pipx" in Path(sys.prefix).parts:
        return f"pipx inject {_DISTRIBUTION} {wanted}"
    python = shlex.quote(sys.executable)
    command = f"{python} -m pip install" if find_spec("pip") else f"uv pip install -p {python}"
    as_root = "" if os.access(sys.prefix, os.W_OK) else "sudo "
    return f"{as_root}{command} {wanted}"


def _requirement(library: str) -> str:
    """Return the library with the versions that fit, as the extra asks for it."""
    try:
        asked = requires(_DISTRIBUTION) or ()
    except PackageNotFoundError:
        return library
    return next((line.split(";")[0].strip() for line in asked if line.startswith(library)), library)
