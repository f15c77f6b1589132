"""A scan of a line in use, in its own protocol at its own baud rate. It only reads."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bridge.commission.asker import ScannedLine
from bridge.commission.examine import look
from bridge.commission.findings import Findings
from bridge.commission.scan_document import findings_document
from bridge.commission.survey import THOROUGH, prober
from bridge.config.schema import LineConfig
from bridge.line.errand import SHARE
from bridge.model import LAST_ADDRESS, LineProtocol
from bridge.protocol.modbus import FIRST_ADDRESS
from bridge.transport.timing import LineTiming

Tell = Callable[[Mapping[str, Any]], None]


class LineScan:
    """One scan. `run` is called in the thread of the line.

    Other baud rates and protocols are not tried, because the stations of the line are in use.
    """

    def __init__(self, line: LineConfig, addresses: Sequence[int], *, thorough: bool) -> None:
        first = 0 if line.protocol is LineProtocol.WISCO else FIRST_ADDRESS
        self.addresses = tuple(sorted(one for one in set(addresses) if one >= first))
        self._line = line
        self._rounds = THOROUGH.tries if thorough else 1
        self._ids = {config.address: config.id for config in line.stations}
        self._findings = Findings()

    @property
    def total_s(self) -> float:
        """Return about the longest time: no other module answers, and the line is busy."""
        timing = LineTiming.from_config(self._line)
        request = prober(self._line.protocol, LAST_ADDRESS).read_inputs
        silent_s = timing.timeout_s(len(request.frame), request.reply_chars)
        if self._line.protocol is LineProtocol.WISCO:
            silent_s += self._line.late_window_s
        return self._rounds * len(self.addresses) * silent_s / SHARE

    def run(self, asked: ScannedLine, tell: Tell) -> Mapping[str, Any]:
        """Ask every station; report the progress before each.

        Raises:
            PortError: The port is gone.
            BridgeError: The line has no time for it any more.
        """
        total = self._rounds * len(self.addresses)
        for turn in range(total):
            tell(self._document(turn / total))
            address = self.addresses[turn % len(self.addresses)]
            baud, protocol = self._line.baud, self._line.protocol
            if not self._findings.is_known(address, baud, protocol):
                for finding in look(asked, baud, protocol, address):
                    self._findings.add(finding)
        return self._document(1.0)

    def _document(self, progress: float) -> Mapping[str, Any]:
        document = findings_document(self._findings)
        for found in document["found"]:
            found["id"] = self._ids.get(found["address"])
        return {"line": self._line.id, "progress": round(progress, 3), **document}
