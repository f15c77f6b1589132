"""A short, stable name of this machine, for the default client id."""

import hashlib
from pathlib import Path

from bridge.config.names import id_from

MACHINE_ID_FILE = Path("/etc/machine-id")
_ID_CHARACTERS = 32


def machine_name(machine_id_file: Path, hostname: str) -> str:
    """Return 8 hex digits derived from the machine id, or from the host name if there is none."""
    try:
        machine_id = machine_id_file.read_bytes().strip()
    except OSError:
        machine_id = b""
    # A first boot writes the word "uninitialized" there, which is equal on all machines.
    if len(machine_id) != _ID_CHARACTERS:
        return id_from(hostname) or "host"
    # machine-id(5) asks not to publish the id itself, so it is hashed.
    return hashlib.sha256(b"wisco2mqtt " + machine_id).hexdigest()[:8]
