"""Numbers keep the digits that mean something; names from outside cannot play tricks."""

import numpy as np
import pytest

from poise.viewing.wording import NOT_IDENTIFIABLE, counted, readable, rounded


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (0.932345, 0.00184, ("0.9323", "0.0018")),
        (43.9123, 0.11, ("43.91", "0.11")),
        (-0.00004, 0.002, ("0.0000", "0.0020")),
        (123.4, 25.0, ("123", "25")),
        (123456.0, 2500.0, ("123456", "2500")),
        (1.5, 0.0, ("1.5", "")),
        (1.23456, np.nan, ("1.235", "")),
        (0.0, np.inf, ("0", "")),
        (np.nan, 1.0, (NOT_IDENTIFIABLE, "")),
        (np.inf, 1.0, (NOT_IDENTIFIABLE, "")),
    ],
)
def test_a_value_has_the_digits_that_its_uncertainty_leaves(
    value: float, sigma: float, expected: tuple[str, str]
) -> None:
    assert rounded(value, sigma) == expected


@pytest.mark.parametrize("scale", 10.0 ** np.arange(-12, 7))
def test_rounding_stays_within_a_twentieth_of_sigma_at_any_scale(scale: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        value, sigma = scale * rng.normal() * 100, scale * rng.uniform(0.1, 10)
        shown, spread = rounded(value, sigma)
        assert abs(float(shown) - value) <= 0.0501 * sigma
        assert abs(float(spread) - sigma) <= 0.0501 * sigma
        assert len(shown) < 20


def test_control_and_direction_characters_are_made_visible() -> None:
    assert readable("a\0b\x1b[31m\u202egnp\udcff\n") == "a�b�[31m�gnp��"


def test_an_endless_name_is_cut_and_says_so() -> None:
    shown = readable("x" * 100_000)
    assert len(shown) < 300
    assert "99800 more characters" in shown


def test_ordinary_names_in_any_language_are_left_alone() -> None:
    for name in ("ft_sensor", "Kraft­messer".replace("\u00ad", ""), "力センサ", "a<b & 'c'"):
        assert readable(name) == name


def test_one_is_singular() -> None:
    assert (counted(1, "sample"), counted(0, "sample"), counted(2, "sample")) == ("1 sample", "0 samples", "2 samples")
