"""What only nearly touches carries nothing that is planned."""

import numpy as np
import pytest

from benchmarks.placement import scenes
from poise.assembly import Analysis
from poise.geometry import Pose
from poise.placement import Validator


@pytest.mark.parametrize(("gap", "stays"), [(0.0, True), (1e-4, True), (1e-3, False)])
def test_a_gap_within_the_tolerance_of_scans_is_no_contact(gap, stays):
    validator = Validator(Analysis.of(scenes.scene("cube")), scenes.cube(), settling=False)
    accepted = validator.accept(Pose(np.eye(3), np.array([0, 0, 0.15 + gap])))
    assert (accepted is not None) == stays
