"""Long extents of a scanned shape are known to a smaller share than thin ones; those of bodies from CAD are not."""

import numpy as np
import pytest

from poise.inertia.bayes.hypotheses import hypotheses_for_shape
from poise.inertia.bayes.mass_model import MassModel
from poise.inertia.model import NoiseLevels, cloud_accuracy
from poise.inertia.model.parts import Parts, box_moments

SIDES = np.array([0.2, 0.03, 0.008])
DIAGONAL = [0, 3, 5]
SCANNED, FROM_CAD = 0.02, 0.001


def box(sides: np.ndarray) -> MassModel:
    parts = Parts.from_moments(box_moments(np.array([[0.02, 0.0, 0.1]]), sides[None]), [0], np.zeros((1, 3)))
    return MassModel.of_parts(parts.unit_phi, parts.volumes)


def test_a_surface_that_is_off_changes_extents_as_the_factors_say() -> None:
    model, moved = box(SIDES), box(SIDES + 1e-7)
    change = moved.radii / model.radii - 1
    np.testing.assert_allclose(np.sqrt(model.long_extents(0.0)[DIAGONAL]), change / change.max(), rtol=1e-4)


def test_factors_lie_between_the_least_and_one_and_do_not_depend_on_the_unit() -> None:
    factors = box(SIDES).long_extents(0.5)
    assert factors[0] == pytest.approx(1.0)
    assert np.all((factors[:6] > 0.25) & (factors[:6] <= 1.0))
    assert factors[5] == pytest.approx(0.25, abs=0.01)
    np.testing.assert_array_equal(factors[6:], 1.0)
    np.testing.assert_allclose(box(1000 * SIDES).long_extents(0.5), factors, rtol=1e-9)
    np.testing.assert_allclose(box(np.full(3, 0.05)).long_extents(0.5), 1.0)


def test_only_a_shape_whose_parts_are_guesses_has_better_known_long_extents() -> None:
    model = box(SIDES)
    for accuracy, expected in ((FROM_CAD, np.ones(9)), (SCANNED, model.long_extents(0.5))):
        cases = hypotheses_for_shape(model, accuracy, 0.0, NoiseLevels())
        stated = cases.state_variances[cases.as_stated & ~cases.uneven][:, -9:]
        as_given = np.array([accuracy**2] * 6 + [0.49 * accuracy**2] * 3)
        np.testing.assert_allclose(stated, np.tile(as_given * expected, (len(stated), 1)), rtol=1e-9)


def test_a_shape_that_is_not_the_objects_is_as_free_along_all_axes() -> None:
    cases = hypotheses_for_shape(box(SIDES), SCANNED, 0.0, NoiseLevels())
    wrong = cases.state_variances[cases.wrong_shape][:, -9:-3]
    np.testing.assert_array_equal(wrong, np.full_like(wrong, 0.25))


def test_the_accuracy_of_a_cloud_grows_with_the_uncertainty_of_its_volume_between_the_best_and_the_worst() -> None:
    stated = [cloud_accuracy(1e-4, share * 1e-4) for share in (1e-3, 0.03, 0.1, 0.3, 10.0)]
    assert np.all(np.diff(stated) > 0)
    assert stated[0] == pytest.approx(0.01, rel=0.01)
    assert stated[-1] == pytest.approx(0.08)
    unknown = [cloud_accuracy(*given) for given in ((0.0, 1e-6), (1e-4, 0.0), (1e-4, np.inf), (np.nan, 1e-6))]
    np.testing.assert_array_equal(unknown, 0.05)
