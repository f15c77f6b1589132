"""The errors of the bridge, by what happens next.

BridgeError
├── ConfigError          nothing was started: exit 78, one line a problem
├── PortError            close the port, back off, reopen
│   └── PortBusyError    another program has it: the bridge, as a rule
├── ExchangeError        one request did not get its answer
│   ├── NoReplyError     count; retry where that is safe
│   ├── BadReplyError    count; retry where that is safe; carries the bytes
│   └── RefusedError     a valid answer that says no: never retry
├── ExpiredError         nothing was sent: its time was over before the line was free
└── CommandError         answer with a verdict
"""

from collections.abc import Sequence
from dataclasses import dataclass


class BridgeError(Exception):
    """Base of every error that this package raises on purpose."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong with a configuration, and where: line and column count from 1."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class ConfigError(BridgeError):
    """The configuration is wrong or missing. Carries every problem at once."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class PortError(BridgeError):
    """The port is gone or cannot be opened: close it, back off, reopen."""


class PortBusyError(PortError):
    """Another program holds the port: go through that one, or stop it."""


class ExchangeError(BridgeError):
    """One request did not get the answer that it asked for."""


class NoReplyError(ExchangeError):
    """Not a single byte came back within the deadline.

    `reading` is the id of the reading of docs/protocol.md that explains it; None: none that does.
    """

    def __init__(self, message: str, reading: str | None = None) -> None:
        self.reading = reading
        super().__init__(message)


class BadReplyError(ExchangeError):
    """Describe what came back is not a valid reply to this request. Carries the bytes."""

    def __init__(self, message: str, data: bytes) -> None:
        self.data = data
        super().__init__(f"{message}: {data.hex(' ') or 'no bytes'}")


class RefusedError(ExchangeError):
    """A valid answer that says no (`ERR=n`, a Modbus exception): never retry.

    `code` is the digit of `ERR=` (docs/protocol.md section 2) or the Modbus exception code
    (section 3); `name` is its name there.
    """

    def __init__(self, code: int, name: str) -> None:
        self.code = code
        self.name = name
        super().__init__(f"refused with code {code} ({name})")


class ExpiredError(BridgeError):
    """A request was not sent: when the line was free for it, its time was over."""


class CommandError(BridgeError):
    """A command cannot be taken; `reason` is the word that its verdict carries."""

    def __init__(self, reason: str, detail: str) -> None:
        self.reason = reason
        self.detail = detail
        super().__init__(f"{reason}: {detail}")
