"""Replays a record: each request gets the replies that followed it there, in their order."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from bridge.transcript import Entry

_REQUEST = ">"
# The bridge accepts a change over Wisco frames after two equal reads (docs/contract.md, promise 5).
_BELIEVED_AFTER = 2


@dataclass(slots=True)
class _Run:
    """The same answer, this many times in a row."""

    answer: bytes
    since_s: float
    count: int = 1


@dataclass(slots=True)
class _Script:
    """All answers to one request, and the position in them."""

    runs: list[_Run] = field(default_factory=list)
    at: int = 0
    given: int = 0


class Recording:
    """The replies of a transcript. Only the thread of the line uses it.

    An answer never comes earlier than in the record. Each answer that differs from the one before
    it is given: a master that asks less often gets them later, but none is left out. The last
    answer repeats. A request without an answer in the record gets none here.
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
        if reply:  # else the record ends before the answer
            self._add(asked, reply)

    def answer(self, frame: bytes, now: float) -> bytes:
        """Return the answer to a request at this instant; empty if there is none."""
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
