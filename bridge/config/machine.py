"""A short name of this machine that stays the same, for the default client id."""

import hashlib
from pathlib import Path

from bridge.config.names import id_from

MACHINE_ID_FILE = Path("/etc/machine-id")
_ID_CHARACTERS = 32


def machine_name(machine_id_file: Path, hostname: str) -> str:
    """Give 8 hex digits made from the machine id, or the host name where there is none."""
    try:
        machine_id = machine_id_file.read_bytes().strip()
    except OSError:
        machine_id = b""
    # A first boot leaves the word "uninitialized" there: it would be the same everywhere.
    if len(machine_id) != _ID_CHARACTERS:
        return id_from(hostname) or "host"
    # machine-id(5) asks not to show the id itself: it goes over the network hashed.
    return hashlib.sha256(b"wisco2mqtt " + machine_id).hexdigest()[:8]
