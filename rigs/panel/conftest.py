"""One browser and one house, which the tests of a module share."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from panel.browser import chromium
from panel.house import PanelHouse, panel_house


@pytest.fixture(scope="session", name="browser")
def _browser() -> Iterator[Browser]:
    """Chromium, for all tests."""
    with chromium() as browser:
        yield browser


@pytest.fixture(name="house", scope="module")
def _house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelHouse]:
    """A house with modules, without a password."""
    with panel_house(tmp_path_factory.mktemp("house")) as house:
        yield house
