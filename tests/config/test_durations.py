"""Times as the configuration writes them."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.config.durations import parse_duration


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("50ms", "0.05"),
        ("0.5s", "0.5"),
        ("10min", "600"),
        ("0", "0"),
        ("0ms", "0"),
        ("2.5ms", "0.0025"),
        ("1.5min", "90"),
    ],
)
def test_a_duration_is_a_number_and_its_unit(text: str, seconds: str) -> None:
    """Milliseconds, seconds or minutes, exactly; zero needs no unit."""
    assert parse_duration(text) == Decimal(seconds)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5",
        "ms",
        "50 ms",
        "50MS",
        "05s",
        "-1s",
        "+1s",
        "1e3ms",
        "1_0s",
        ".5s",
        "5.s",
        "1h",
        "\N{ARABIC-INDIC DIGIT FIVE}s",
    ],
)
def test_anything_else_is_no_duration(text: str) -> None:
    """No unit, another unit, or a number that is not plain decimal."""
    with pytest.raises(ValueError, match=r"^"):
        parse_duration(text)


@given(st.integers(0, 999_999_999), st.sampled_from(["ms", "s", "min"]))
def test_every_whole_number_of_a_unit_is_exact(count: int, unit: str) -> None:
    """No float comes in between."""
    assert parse_duration(f"{count}{unit}") == count * parse_duration(f"1{unit}")
