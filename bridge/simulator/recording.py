"""Answers as they were recorded: to each request what followed it, in the order of the record."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from bridge.transcript import Entry

_REQUEST = ">"
# A bridge believes a change over Wisco frames once it was read twice (docs/contract.md, promise 5).
_BELIEVED_AFTER = 2


@dataclass(slots=True)
class _Run:
    """The same answer, so many times in a row."""

    answer: bytes
    since_s: float
    count: int = 1


@dataclass(slots=True)
class _Script:
    """All answers to one request, and where the replay is among them."""

    runs: list[_Run] = field(default_factory=list)
    at: int = 0
    given: int = 0


class Recording:
    """The replies of a transcript. The line's thread is its only user.

    An answer comes no sooner than it did in the record, and each that differs from the one before
    it comes: a master that asks less often than the recorded master gets them later, and none is
    left out. The last one stays. A request that got no answer in the record gets none here.
    """

    def __init__(self, entries: Iterable[Entry]) -> None:
        self._scripts: dict[bytes, _Script] = defaultdict(_Script)
        self._began: float | None = None
        self._first_s: float | None = None
        asked: Entry | None = None
        reply: list[bytes] = []
        for entry in entries:
            if entry.way != _REQUEST:
                reply.append(entry.data)
                continue
            self._add(asked, reply)
            asked, reply = entry, []
        if reply:  # else the record ends before the answer, which is none of its facts
            self._add(asked, reply)

    def answer(self, frame: bytes, now: float) -> bytes:
        """Return the answer to a request at this instant; nothing where none is known."""
        self._began = now if self._began is None else self._began
        script = self._scripts.get(frame)
        if script is None:
            return b""
        current = script.runs[script.at]
        following = script.runs[script.at + 1 : script.at + 2]
        shown = script.given >= min(current.count, _BELIEVED_AFTER)
        if shown and following and now - self._began >= following[0].since_s:
            script.at, script.given, current = script.at + 1, 0, following[0]
        script.given += 1
        return current.answer

    def _add(self, asked: Entry | None, reply: list[bytes]) -> None:
        if asked is None:
            return  # noise before the first request
        self._first_s = asked.at if self._first_s is None else self._first_s
        answer, runs = b"".join(reply), self._scripts[asked.data].runs
        if runs and runs[-1].answer == answer:
            runs[-1].count += 1
        else:
            runs.append(_Run(answer, asked.at - self._first_s))
