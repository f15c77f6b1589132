"""Simulated modules behind a port in virtual time: a scan of minutes takes a moment."""

import itertools
import random
from collections.abc import Iterable

from support.virtual_port import VirtualPort, VirtualTime

from bridge.model import LineProtocol
from bridge.simulator import modbus, wisco
from bridge.simulator.conversation import Conversation, Send
from bridge.simulator.dialect import Dialect, Tongue
from bridge.simulator.faults import Faults
from bridge.simulator.module import SimulatedModule
from bridge.simulator.wire import Pace


class VirtualPanel:
    """One line at one baud rate in one protocol. What asks at another rate is not heard.

    Attributes:
        modules: By station; one more under another key may share a station, and answers second.
        sent: Every frame that was sent, with its baud rate.
        opened: The baud rates at which the port was opened, in this order.
    """

    def __init__(
        self,
        protocol: LineProtocol,
        baud: int,
        modules: Iterable[SimulatedModule],
        *,
        turnaround_s: float = 0.002,
        seed: int = 1,
        dialects: Iterable[Dialect] = (),
    ) -> None:
        self.time = VirtualTime()
        self.baud = baud
        self.faults = Faults(random.Random(seed))  # noqa: S311 - damage, not secrets
        self.sent: list[tuple[int, bytes]] = []
        self.opened: list[int] = []
        self.modules = {module.address: module for module in modules}
        pace = Pace.of(protocol, baud, turnaround_s, paced=True)
        self.conversation = Conversation(
            protocol, self.modules, pace, self.faults, tongue=Tongue.of(tuple(dialects))
        )

    def open(self, baud: int) -> "PanelPort":
        """Opens the port."""
        self.opened.append(baud)
        return PanelPort(self, baud)


class PanelPort:
    """Satisfies `Port`."""

    name = "virtual"

    def __init__(self, panel: VirtualPanel, baud: int) -> None:
        self._panel = panel
        self._baud = baud
        self._arrived = b""

    def write(self, data: bytes, deadline: float) -> None:
        """See `Port`."""
        assert self._panel.time.now <= deadline
        self._panel.sent.append((self._baud, data))
        if self._baud == self._panel.baud:
            self._panel.conversation.hear(data, self._panel.time.now)

    def read(self, count: int, deadline: float) -> bytes:
        """See `Port`."""
        time, conversation = self._panel.time, self._panel.conversation
        self._take_in()
        while len(self._arrived) < count:
            at = conversation.next_at()
            if at is None or at > deadline:
                time.now = max(time.now, deadline)
                break
            time.now = max(time.now, at)
            self._take_in()
        taken, self._arrived = self._arrived[:count], self._arrived[count:]
        return taken

    def discard(self) -> bytes:
        """See `Port`."""
        self._take_in()
        taken, self._arrived = self._arrived, b""
        return taken

    def close(self) -> None:
        """See `Port`."""

    def _take_in(self) -> None:
        for effect in self._panel.conversation.advance(self._panel.time.now):
            assert isinstance(effect, Send)
            self._arrived += effect.data


def collision(time: VirtualTime, *modules: SimulatedModule) -> VirtualPort:
    """A port behind which all of `modules` answer at once: where they differ, bits are lost."""

    def answer(frame: bytes) -> list[tuple[float, bytes]]:
        replies = [reply for module in modules if (reply := _reply(module, frame))]
        mixed = (min(column) for column in itertools.zip_longest(*replies, fillvalue=0xFF))
        return [(0.03, bytes(mixed))] if replies else []

    return VirtualPort(time, answer)


def _reply(module: SimulatedModule, frame: bytes) -> bytes | None:
    if frame.startswith(b"#"):
        return wisco.answer(module, frame)
    if frame.startswith(b":"):
        return modbus.answer_ascii(module, frame)
    return modbus.answer_rtu(module, frame)
