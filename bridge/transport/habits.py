"""Notices why a module that is there does not answer: it is slow, or wants silence. Pure."""

_QUICK_S = 0.02  # a request this soon after the last byte gives a module hardly any silence
_QUICK_MISSED = 4
_PATIENT_HEARD = 3


class Habits:
    """What shows of one station by when it answers. Rules of docs/protocol.md, Readings."""

    __slots__ = ("_patient_heard", "_quick_missed", "is_late")

    def __init__(self) -> None:
        self.is_late = False  # what it said last came after the time-out
        self._quick_missed = 0
        self._patient_heard = 0

    def heard(self, gap_s: float) -> None:
        """Note a good reply to a request that followed a silence of so long."""
        self.is_late = False
        if gap_s < _QUICK_S:
            self._quick_missed = self._patient_heard = 0
        else:
            self._patient_heard += 1

    def missed(self, gap_s: float) -> None:
        """Note that nothing came."""
        if gap_s < _QUICK_S:
            self._quick_missed += 1

    @property
    def reading(self) -> str | None:
        """Return the id of the reading that explains a missing reply."""
        if self.is_late:
            return "turnaround"
        wants_silence = self._quick_missed >= _QUICK_MISSED
        return "silence-before" if wants_silence and self._patient_heard >= _PATIENT_HEARD else None
