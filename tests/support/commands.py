"""Commands as the tests of lines and hub write them."""

from bridge.model import Command, Word, channels_of


def make_command(
    mask: int,
    values: int = 0,
    *,
    word: Word | None = None,
    station_id: str = "garage",
    arrived: float = 0.0,
    deadline: float = 2.0,
    command_id: str | int | None = None,
) -> Command:
    """A command for the outputs in `mask`, as an intake would have made it."""
    channels = list(channels_of(mask))
    target = f"do/{channels[0]}" if len(channels) == 1 else "do"
    payload = word.value if word else f"{mask:b} {values:b}"
    return Command(
        station_id,
        target,
        payload,
        mask,
        values,
        word,
        arrived=arrived,
        deadline=deadline,
        id=command_id,
    )
