"""Evidence of columns that a frame has already, in data almost without noise: nothing is gained, and nothing breaks."""

import numpy as np

from poise.mismatch.inference.evidence import WhitenedRegression


def test_columns_that_are_there_already_gain_nothing_however_large_they_are():
    rng = np.random.default_rng(1)
    columns = 1e7 * rng.normal(size=(6, 4000))
    regression = WhitenedRegression((columns,), np.ones(6), np.zeros(6), columns.T @ np.ones(6) + rng.normal(size=4000))
    again = np.vstack([columns * 3.0, columns[::-1] * (1.0 + 1e-9)])
    projected = regression.project(again)
    assert np.isfinite(projected.fitted(np.full(12, 1e-6))[0]).all()
    assert np.isfinite(projected.gain(np.full(12, 1e-6)))
