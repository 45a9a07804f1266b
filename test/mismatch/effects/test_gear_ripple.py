"""The spectrum of a torque over the position of a joint against least squares."""

import numpy as np

from poise.mismatch.effects.gear_ripple import _spectrum


def test_the_spectrum_is_that_of_least_squares_where_a_joint_stops_at_few_places() -> None:
    """A slide that stops at three places spends most samples there: a plain transform sees those alone."""
    rng = np.random.default_rng(2)
    way = [np.full(3000, 0.1), np.linspace(0.1, 0.22, 300), np.full(3000, 0.22), np.linspace(0.22, 0.15, 200)]
    position = np.concatenate([*way, np.full(2000, 0.15)])
    residual = 0.07 * np.sin(157.0 * position + 1.0) + 0.01 * rng.normal(size=len(position))
    orders, power = _spectrum(position, residual)
    best = float(orders[np.argmax(power)])
    cubic = np.vander(position - position.mean(), 4)
    waves = np.column_stack([cubic, np.sin(best * position), np.cos(best * position)])
    smooth, left = (
        np.sum((residual - each @ np.linalg.lstsq(each, residual, rcond=None)[0]) ** 2) for each in (cubic, waves)
    )
    assert abs(best - 157.0) < 2.0
    np.testing.assert_allclose(power.max(), 0.5 * len(residual) * (1.0 - left / smooth), rtol=0.05)
