"""A sensor under a load that hardly changes shows no creep and no nonlinearity: a bias has the same response."""

import numpy as np
import pytest

from poise.mismatch.effects.load_changes import imitates_gain
from poise.mismatch.effects.part_motion import crept

SECONDS = np.linspace(0.0, 30.0, 3001)


@pytest.mark.parametrize("respond", [lambda load: 0.08 * crept(SECONDS, load, 5.0), lambda load: 1e-3 * load**3])
def test_a_load_that_hardly_changes_shows_no_more_than_a_gain(respond):
    still = np.outer(1.0 + 0.004 * np.sin(3.0 * SECONDS), [2.0, -1.0, -50.0, 0.1, 0.2, 0.3])
    turned = np.outer(np.cos(0.4 * SECONDS), [2.0, -1.0, -50.0, 0.1, 0.2, 0.3])
    assert "gain or a bias" in imitates_gain(still, respond(still))
    assert imitates_gain(turned, respond(turned)) == ""


def test_a_gain_and_a_bias_imitate_themselves():
    load = np.random.default_rng(3).normal(size=(200, 6))
    assert imitates_gain(load, 0.03 * load + 1.5) != ""
