"""The files of `monitor --record`: a text transcript, or pcapng, by the file name."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Protocol, TextIO

from bridge.cli.views.monitor_view import note_of
from bridge.commission.pcapng import PcapngWriter
from bridge.errors import BridgeError
from bridge.protocol.passive.listener import Heard, PieceWay
from bridge.transcript import Entry, format_entry, format_header

_PCAPNG = ".pcapng"


class Recorder(Protocol):
    """Records what was heard."""

    def record(self, heard: Heard) -> None:
        """Record one piece."""


class TranscriptRecorder:
    """Writes text line by line, so that a killed monitor leaves what it heard."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._started: float | None = None
        self._has_protocol = False

    def begin(self, baud: int) -> None:
        """Write the head of the file."""
        self._write(format_header("baud", str(baud)))

    def record(self, heard: Heard) -> None:
        """Record one piece."""
        if not heard.data:
            return
        if self._started is None:
            self._started = heard.at
        if heard.protocol and not self._has_protocol:
            self._has_protocol = True
            self._write(format_header("protocol", heard.protocol))
        who = "" if heard.address is None else f"{heard.address} "
        entry = Entry(heard.at - self._started, heard.way, heard.data)
        self._write(format_entry(entry, f"{who}{note_of(heard)}"))

    def _write(self, text: str) -> None:
        self._file.write(text)
        self._file.flush()


class PcapngRecorder:
    """Writes frames for Wireshark; noise is included, with a comment."""

    def __init__(self, file: BinaryIO, epoch_s: float) -> None:
        self._file = file
        self._writer = PcapngWriter(file)
        self._epoch_s = epoch_s

    def begin(self, port: str) -> None:
        """Write the head of the file."""
        self._writer.begin(port)

    def record(self, heard: Heard) -> None:
        """Record one piece."""
        if heard.data:
            reply = heard.way is PieceWay.REPLY
            at_s = self._epoch_s + heard.at
            self._writer.frame(at_s, heard.data, reply=reply, comment=heard.problem)
            self._file.flush()


@contextmanager
def recording(path: Path, port: str, baud: int, epoch_s: float) -> Iterator[Recorder]:
    """Open a new file within the block.

    `epoch_s` is the offset from the instants of the listener to seconds since 1970.

    Raises:
        BridgeError: It exists already, or cannot be written.
    """
    try:
        if path.suffix.lower() == _PCAPNG:
            with path.open("xb") as binary:
                capture = PcapngRecorder(binary, epoch_s)
                capture.begin(port)
                yield capture
        else:
            with path.open("x", encoding="utf-8") as text:
                transcript = TranscriptRecorder(text)
                transcript.begin(baud)
                yield transcript
    except FileExistsError:
        raise BridgeError(f"{path} is there already: record into a new file") from None
    except OSError as error:
        raise BridgeError(f"{path} cannot be written: {error.strerror}") from error
