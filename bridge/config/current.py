"""The one source of the configuration: who needs it asks, and a reload replaces it."""

from bridge.config.schema import Config, StationConfig


class CurrentConfig:
    """Holds the configuration in force. Replaced by the main thread alone.

    Attributes:
        config: The configuration in force.
        stations: Its stations by their id.
        line_of: The id of the line of each station.
    """

    def __init__(self, config: Config) -> None:
        self.replace(config)

    def replace(self, config: Config) -> None:
        """Go by `config` from now on."""
        self.config = config
        on_lines = list(config.on_lines)
        self.stations: dict[str, StationConfig] = {station.id: station for _, station in on_lines}
        self.line_of = {station.id: line.id for line, station in on_lines}
