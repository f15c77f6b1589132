"""The words that the bridge adds to names of entities, in the language of the configuration."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Words:
    """What a channel's further entities are called, after the name of the channel."""

    press: str = "press"
    count: str = "count"
    relay: str = "relay"
    mode: str = "mode"
    hold_time: str = "hold time"


WORDS = {
    "en": Words(),
    "de": Words("Tastendruck", "Zähler", "Relais", "Betriebsart", "Haltezeit"),
    "th": Words("การกด", "จำนวนครั้ง", "รีเลย์", "โหมด", "เวลาค้าง"),
}
