"""The errors of the bridge, by what happens next.

BridgeError
├── ConfigError          nothing was started: exit 78, one line for each problem
├── PortError            close the port, wait, open it again
│   └── PortBusyError    another program has it, usually the bridge
├── ExchangeError        one request did not get its answer
│   ├── NoReplyError     count; retry if that is safe
│   ├── BadReplyError    count; retry if that is safe; carries the bytes
│   └── RefusedError     a valid answer that refuses: never retry
├── ExpiredError         nothing was sent: the deadline passed before the line was free
└── CommandError         answer with a verdict
"""

from collections.abc import Sequence
from dataclasses import dataclass


class BridgeError(Exception):
    """Base of every error that this package raises on purpose."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a configuration and its place; line and column count from 1."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class ConfigError(BridgeError):
    """The configuration is wrong or missing. Carries every problem."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class PortError(BridgeError):
    """The port is gone or cannot be opened: close it, wait, open it again."""


class PortBusyError(PortError):
    """Another program holds the port: use that program, or stop it."""


class ExchangeError(BridgeError):
    """One request did not get its answer."""


class NoReplyError(ExchangeError):
    """No byte came back within the deadline."""


class BadReplyError(ExchangeError):
    """The bytes that came back are not a valid reply to the request. Carries the bytes."""

    def __init__(self, message: str, data: bytes) -> None:
        self.data = data
        super().__init__(f"{message}: {data.hex(' ') or 'no bytes'}")


class RefusedError(ExchangeError):
    """A valid answer that refuses (`ERR=n`, a Modbus exception): never retry.

    `code` is the digit of `ERR=` (docs/protocol.md section 2) or the Modbus exception code (section
    3); `name` is its name there.
    """

    def __init__(self, code: int, name: str) -> None:
        self.code = code
        self.name = name
        super().__init__(f"refused with code {code} ({name})")


class ExpiredError(BridgeError):
    """A request was not sent: its deadline passed before the line was free."""


class CommandError(BridgeError):
    """A command cannot be carried out; `reason` is the word in its verdict."""

    def __init__(self, reason: str, detail: str) -> None:
        self.reason = reason
        self.detail = detail
        super().__init__(f"{reason}: {detail}")
