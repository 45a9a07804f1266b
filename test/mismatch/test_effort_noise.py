"""The white level of joint efforts, with the knocks of gears in them."""

import numpy as np
import pytest

from poise.mismatch.recorded import white_level


def test_knocks_are_no_noise_where_the_signal_is_finely_resolved() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4000, 1)) * 0.3
    values[rng.choice(4000, 120, replace=False)] += rng.normal(size=(120, 1)) * 60.0
    assert white_level(values, coarse=False)[0] == pytest.approx(0.3, rel=0.2)


def test_plain_noise_is_measured_alike_both_ways() -> None:
    values = np.random.default_rng(1).normal(size=(4000, 3)) * [0.1, 1.0, 5.0]
    for coarse in (True, False):
        assert white_level(values, coarse) == pytest.approx([0.1, 1.0, 5.0], rel=0.1)
