"""What a valid configuration had better not do: for people to read, never an error."""

import re
from collections.abc import Iterator

from bridge.config.schema import Config

_NUMBERED = re.compile(r"/dev/tty(USB|ACM)[0-9]+")


def advice_on(config: Config) -> Iterator[str]:
    """Yield one line a piece of advice."""
    local = [line for line in config.lines if line.port.startswith("/")]
    for line in local:
        # docs/failures.md A13: with one adapter alone there is nothing to be mistaken for.
        if len(local) > 1 and _NUMBERED.fullmatch(line.port):
            yield (
                f"line {line.id}: {line.port} may be another adapter after the next start or "
                "replug, and commands would go to the wrong line; write its path below "
                "/dev/serial/by-id (ls -l /dev/serial/by-id shows them), or by-path"
            )
