"""The one source of the configuration: its readers ask it, and a reload replaces it."""

from bridge.config.schema import Config


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
        self.stations = {
            station_config.id: station_config for _, station_config in config.all_stations
        }
        self.line_of = {station_config.id: line.id for line, station_config in config.all_stations}
