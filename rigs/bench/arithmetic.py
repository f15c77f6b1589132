"""The limit that the wire sets.

It is computed from docs/protocol.md section 5 alone, without code of the bridge.
"""

from dataclasses import dataclass

BITS_A_CHARACTER = 10
# Characters of request and reply: a DIO100's inputs, outputs, and its modes and hold times.
# The last is Modbus alone: a read of nine registers, over ASCII on a Wisco line.
CHARACTERS = {
    "wisco": (8 + 8, 8 + 6, 17 + 47),
    "modbus-rtu": (8 + 7, 8 + 6, 8 + 23),
    "modbus-ascii": (17 + 15, 17 + 13, 17 + 47),
}
RTU_SILENCE_CHARACTERS = 3.5
RTU_LEAST_SILENCE_S = 0.00175  # in place of 3.5 characters above 19200 baud
SLOW_BAUD = 19200


@dataclass(frozen=True, slots=True)
class Physics:
    """The times of one line, in seconds. Unpaced: all of them are 0."""

    character_s: float
    silence_s: float
    turnaround_s: float

    @classmethod
    def of(cls, protocol: str, baud: int, turnaround_s: float) -> "Physics":
        """A line as it is."""
        character_s = BITS_A_CHARACTER / baud
        silence_s = 0.0
        if protocol == "modbus-rtu":
            silence_s = RTU_LEAST_SILENCE_S
            if baud <= SLOW_BAUD:
                silence_s = RTU_SILENCE_CHARACTERS * character_s
        return cls(character_s, silence_s, turnaround_s)

    def exchange_s(self, characters: int) -> float:
        """The floor of one exchange: two silences, of which the module keeps one."""
        return characters * self.character_s + 2 * self.silence_s + self.turnaround_s


UNPACED = Physics(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Limit:
    """The least that exchanges with a DIO100 take of a line, in seconds."""

    inputs_s: float
    outputs_s: float
    settings_s: float

    @classmethod
    def of(cls, protocol: str, physics: Physics) -> "Limit":
        """From the table of characters."""
        return cls(*(physics.exchange_s(characters) for characters in CHARACTERS[protocol]))

    def cycle_s(self, stations: int) -> float:
        """Inputs and outputs of every station once."""
        return stations * (self.inputs_s + self.outputs_s)

    def start_s(self, stations: int) -> float:
        """Everything that is retained of every station once."""
        return stations * (self.inputs_s + self.outputs_s + self.settings_s)
