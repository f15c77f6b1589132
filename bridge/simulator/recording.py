"""Answers as they were recorded: to each request what followed it, in the order of the record."""

from collections import defaultdict, deque
from collections.abc import Iterable

from bridge.transcript import Entry

_REQUEST = ">"


class Recording:
    """The replies of a transcript. The line's thread is its only user.

    What was asked five times gets its five answers one after the other, then the last for ever.
    A request that got none in the record gets none here.
    """

    def __init__(self, entries: Iterable[Entry]) -> None:
        self._answers: dict[bytes, deque[bytes]] = defaultdict(deque)
        asked = b""
        reply = b""
        answered = False
        for entry in entries:
            if entry.way != _REQUEST:
                reply, answered = reply + entry.data, True
                continue
            self._add(asked, reply)
            asked, reply, answered = entry.data, b"", False
        if answered:  # else the record ends before the answer, which is none of its facts
            self._add(asked, reply)

    def answer(self, frame: bytes) -> bytes:
        """The next answer to a request; nothing where none is known."""
        answers = self._answers.get(frame)
        if not answers:
            return b""
        return answers.popleft() if len(answers) > 1 else answers[0]

    def _add(self, asked: bytes, reply: bytes) -> None:
        if asked:
            self._answers[asked].append(reply)
