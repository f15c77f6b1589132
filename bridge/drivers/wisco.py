"""One station in Wisco frames: hex reads, because they are the shortest, and masked writes."""

from bridge.model import ModuleType
from bridge.protocol.checks import within_width
from bridge.protocol.request import Request
from bridge.protocol.wisco import ReadInputsHex, ReadOutputsHex, WriteOutputsMasked


class WiscoDriver:
    """A Driver in Wisco frames. Stations 0-31."""

    def __init__(self, address: int, module: ModuleType) -> None:
        self.address = address
        self.module = module
        # docs/protocol.md section 2: only EEPROM replies have a checksum, and none has a station.
        self.protected = False
        self.read_inputs: Request[int] = ReadInputsHex(address)
        self.read_outputs: Request[int] = ReadOutputsHex(address, module)

    def write_outputs(self, mask: int, values: int, current: int) -> Request[None]:  # noqa: ARG002  # the mask spares the gaps
        """Return the write of outputs (see `Driver`).

        Values outside the mask are 0, as in the manual.
        """
        within_width("values", values, self.module.outputs)
        return WriteOutputsMasked(self.address, self.module, mask, values & mask)
