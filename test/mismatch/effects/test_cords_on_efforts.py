"""A cord on the tool as joint efforts show it: one of several joints alone hardly shows a cord."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import TYPICAL, effort_world, filled

from poise.mismatch.effects import effect_named
from poise.mismatch.reading.load_on_efforts import acting_on_efforts


@pytest.mark.parametrize(("quiet", "alone"), [(slice(None), False), (3, True)])
def test_a_cord_that_one_of_several_joints_shows_is_no_likelier_than_a_spring_of_this_joint(quiet, alone):
    cord, at = acting_on_efforts(effect_named("cable")), effort_world()
    noise = np.full(at.effort.measured.shape[1], 1e3)
    noise[quiet] = 0.1
    error = np.random.default_rng(0).normal(size=at.effort.measured.shape) * noise
    efforts = replace(at.effort, measured=at.effort.prediction + error)
    seen = replace(at, wrench=np.full_like(at.wrench, np.nan), effort=efforts)
    assert ("unknown:joint_position" in cord.twins(seen, filled(cord, seen, TYPICAL["cable"]))) == alone
