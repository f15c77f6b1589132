"""Advice on a valid configuration: for people to read, never an error."""

import re
from collections.abc import Iterator

from bridge.config.schema import Config
from bridge.config.version import changed_keys

_NUMBERED = re.compile(r"/dev/tty(USB|ACM)[0-9]+")


def advice_on(config: Config) -> Iterator[str]:
    """Yield one line for each advice."""
    yield from changed_keys(config)
    local = [line for line in config.lines if line.port.startswith("/")]
    for line in local:
        # docs/failures.md A13: with only one adapter there is nothing to confuse it with.
        if len(local) > 1 and _NUMBERED.fullmatch(line.port):
            yield (
                f"line {line.id}: {line.port} may be another adapter after the next start or "
                "replug, and commands would go to the wrong line; write its path below "
                "/dev/serial/by-id (ls -l /dev/serial/by-id shows them), or by-path"
            )
