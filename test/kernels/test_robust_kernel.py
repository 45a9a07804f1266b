"""The compiled robust fit of wrenches against its form in Python, and with bad input."""

import numpy as np
import pytest

from poise.errors import InputError
from poise.kernels import robust_fit
from poise.weighing import fitting

USUAL = {"least": np.array([2e-3, 1e-4]), "huber": 2.0, "rounds": 4}


@pytest.mark.parametrize("count", [4, 75, 300])
@pytest.mark.parametrize("usable", [False, True])
def test_a_fit_is_that_of_python(count: int, usable: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(count)
    matrix = rng.normal(size=(count, 6, 18))
    matrix[:, :3, 4:10] = 0.0
    matrix[:, :, 16] = 0.0  # an unknown that nothing shows
    wrench = matrix @ rng.normal(size=18) + rng.normal(size=(count, 6)) * np.repeat([0.1, 0.005], 3)
    wrench[::7] += 5.0
    counts = rng.random((count, 6)) > 0.2 if usable else None
    given = matrix[:, :, ::-1], wrench[::-1], counts  # with gaps between their numbers
    found = fitting._weighted(*given)
    monkeypatch.setattr(fitting, "COMPILED", False)
    for one, other in zip(found, fitting._weighted(*given), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_bad_input_is_refused_and_no_numbers_stay_none() -> None:
    matrix, wrench = np.ones((5, 6, 3)), np.ones((5, 6))
    for bad in ((matrix[:4], wrench, None), (matrix[:, :5], wrench, None), (matrix, wrench, np.ones((5, 5)))):
        with pytest.raises(InputError):
            robust_fit(*bad, **USUAL)
    with pytest.raises(InputError):
        robust_fit(matrix[:0], wrench[:0], None, **USUAL)
    assert np.isnan(robust_fit(np.full((5, 6, 3), np.nan), wrench, None, **USUAL)[0]).all()
    assert robust_fit(matrix[:, :, :0], wrench, None, **USUAL)[0].shape == (0,)


@pytest.mark.parametrize(("count", "blocks"), [(40, 40), (41, 40), (79, 40), (300, 40), (3, 3), (1, 1)])
def test_blocks_begin_where_numpy_splits(count: int, blocks: int) -> None:
    wanted = [block[0] for block in np.array_split(np.arange(count), blocks)]
    assert fitting.block_starts(count, blocks).tolist() == wanted
