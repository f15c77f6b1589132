"""A line worker without a thread and without a line."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from bridge.config.schema import LineConfig, RuleConfig
from bridge.line.errand import LineTask
from bridge.model import AnyCommand, LeftCover, Orders, StandingCover, StandingCovers


@dataclass
class FakeWorker:
    """A worker that ends when the test says so: `alive = False`."""

    config: LineConfig
    progress: float = 10.0
    failure: str | None = None
    alive: bool = False
    moving: tuple[LeftCover, ...] = ()
    standing: StandingCovers = ()
    inherited: list[LeftCover | StandingCover] = field(default_factory=list)
    stops: int = 0
    away_since: list[float | None] = field(default_factory=list)
    done: list[Orders] = field(default_factory=list)
    commands: list[AnyCommand] = field(default_factory=list)
    tasks: list[LineTask] = field(default_factory=list)
    followed: list[RuleConfig] = field(default_factory=list)

    def inherit(self, left: Iterable[LeftCover], standing: Iterable[StandingCover] = ()) -> None:
        """Take over left and standing covers."""
        self.inherited += [*left, *standing]

    def start(self) -> None:
        """Start."""
        self.alive = True

    def stop(self) -> None:
        """Record the request to end."""
        self.stops += 1

    def broker(self, away_since: float | None, done: Orders = frozenset()) -> None:
        """The broker went away, or came back."""
        self.away_since.append(away_since)
        self.done.append(done)

    def rules(self, active: Iterable[RuleConfig]) -> None:
        """Follows these rules."""
        self.followed = list(active)

    def submit(self, command: AnyCommand) -> None:
        """Takes a command."""
        self.commands.append(command)

    def ask(self, task: LineTask) -> None:
        """Takes what is asked besides."""
        self.tasks.append(task)


def fake_workers() -> tuple[list[FakeWorker], Callable[[LineConfig], FakeWorker]]:
    """Return the workers that were made so far, and what makes one for a line."""
    made: list[FakeWorker] = []

    def make(line: LineConfig) -> FakeWorker:
        made.append(FakeWorker(line))
        return made[-1]

    return made, make
