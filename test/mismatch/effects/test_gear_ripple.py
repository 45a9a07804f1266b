"""The spectrum of a torque over the position of a joint against least squares; what a few waves may stand for."""

import numpy as np
import pytest
from effect_worlds import effort_world

from poise.mismatch.answer.named import equals
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.gear_ripple import _spectrum
from poise.mismatch.inference import FittedEffect


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


@pytest.mark.parametrize(("waves", "beside", "shares"), [(1.4, "time", True), (1.4, "", False), (5.0, "time", False)])
def test_a_few_waves_are_a_piece_of_the_unknown_effect_beside_them(waves: float, beside: str, shares: bool) -> None:
    """The drag of a cable that depends on two joints was `gear_ripple` (93 %), beside an unknown part."""
    effect, at = effect_named("gear_ripple"), effort_world()
    assert effect is not None
    assert at.effort is not None
    order = 2.0 * np.pi * waves / float(np.ptp(at.effort.position[:, 1]))
    values = {"joint": 2.0, "order": order, "sine": 1.0, "cosine": 0.0}
    assert (equals(FittedEffect(effect, values), at, beside) == {"unknown:joint_position"}) == shares
