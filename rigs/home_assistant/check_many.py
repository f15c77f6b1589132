"""A full house: 32 modules with 768 channels."""

import pytest
from home_assistant.home import WAYS, home, started_broker
from home_assistant.houses import many
from home_assistant.releases import Release

_CHANNELS = 768


@pytest.mark.parametrize("way", WAYS)
def test_a_full_house_is_there_soon(
    way: tuple[Release, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Every entity of 32 stations is available; `home` notes the time."""
    release, discovery = way
    directory = tmp_path_factory.mktemp("many")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, many(), discovery) as shown,
    ):
        channels = [k for k in shown.ids() if k.endswith(("_binary_sensor", "_switch"))]
        channels = [k for k in channels if "__di_" in k or "__do_" in k]
        assert len(channels) == _CHANNELS
        sizes = [len(payload) for payload in shown.house.announcements().values()]
        shown.note(f"{len(sizes)} announcements, the largest of {max(sizes)} bytes")
        shown.assistant.restart()
        took_s = shown.wait_until_complete()
        shown.note(f"all available {took_s:.1f} s after a restart of Home Assistant")
        assert shown.assistant.complaints() == []
