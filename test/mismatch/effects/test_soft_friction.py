"""Dry friction as physics engines have it: against MuJoCo's inverse dynamics, and what is gone against its absence."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from effect_worlds import effort_world, filled

from poise.mismatch.effects import effect_named
from poise.mismatch.effects.base import EffectParameter
from poise.mismatch.effects.joint_friction import PRESLIDING, SOFT, likely_reversals
from poise.mismatch.inference import effort_problem
from poise.mismatch.inference.reversals import friction_known, reversal_columns
from poise.mismatch.reading import NominalModel
from poise.simulation.models import JointPhysics

FRICTION = (0.8, 1.4, 0.3, 0.5, 0.9, 0.2)
INERTIA = (0.5, 0.02, 0.1, 0.004, 0.03, 0.002)
LEAD = 0.02 * 0.95 / 2
"""s: solref and solimp of MuJoCo by default."""


def by_mujoco(velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """(M, 6) N m of friction in six joints that do not move one another."""
    spec = mujoco.MjSpec()
    for number, (friction, inertia) in enumerate(zip(FRICTION, INERTIA, strict=True)):
        body = spec.worldbody.add_body(mass=1.0, inertia=[inertia] * 3, explicitinertial=True)
        body.add_joint(name=f"j{number}", axis=[0.0, 0.0, 1.0], frictionloss=friction)
    model = spec.compile()
    data, out = mujoco.MjData(model), np.zeros_like(velocity)
    for row in range(len(velocity)):
        data.qvel[:], data.qacc[:] = velocity[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        out[row] = data.qfrc_inverse - np.array(INERTIA) * acceleration[row]
    return out


def ramps() -> dict[str, float]:
    """The speed of each joint at which friction is complete: impedance 0.9, inverse of the inertia."""
    return {f"ramp_{i}": f / m / 9.0 * LEAD for i, (f, m) in enumerate(zip(FRICTION, INERTIA, strict=True), 1)}


def test_soft_friction_is_mujocos_friction_loss() -> None:
    at, effect = effort_world(), effect_named("coulomb_friction")
    values = ramps() | {"law": 1.0, "lead": LEAD} | {f"torque_{i}": f for i, f in enumerate(FRICTION, 1)}
    found = effect.simulate(at, filled(effect, at, values))
    exact = by_mujoco(at.effort.velocity, at.effort.acceleration)
    assert np.abs(exact).max(axis=0) == pytest.approx(FRICTION)
    np.testing.assert_allclose(found, exact, atol=1e-6)


def test_its_start_finds_the_ramps_of_light_joints_beside_a_load() -> None:
    at = effort_world()
    exact = by_mujoco(at.effort.velocity, at.effort.acceleration)
    found = likely_reversals(at, exact + 0.03 * at.effort.rigid)[SOFT]
    for name, ramp in ramps().items():
        assert 0.7 * ramp < found[name] < 1.5 * ramp or max(ramp, found[name]) < 0.008, name


def test_what_is_gone_acts_although_it_is_at_its_bound() -> None:
    lacking = EffectParameter("torque_1", "N m", 1.0, positive=True)
    there = replace(lacking, known=0.5)
    assert lacking.at_bound(0.0)
    assert not lacking.at_bound(0.1)
    assert not there.at_bound(-0.5)
    assert there.lower == -0.5


def test_friction_that_only_reverses_otherwise_is_explained_without_a_change() -> None:
    at, effect = effort_world(), effect_named("coulomb_friction")
    soft = ramps() | {"law": 1.0, "lead": LEAD} | {f"torque_{i}": f for i, f in enumerate(FRICTION, 1)}
    sharp = soft | {f"ramp_{i}": 0.3 * ramp for i, ramp in enumerate(ramps().values(), 1)}
    off = effect.simulate(at, filled(effect, at, soft)) - effect.simulate(at, filled(effect, at, sharp))
    track = replace(at.effort, measured=at.effort.prediction + off)
    found = reversal_columns(replace(track, errors_cancel=True))
    assert not friction_known(track)
    assert friction_known(replace(track, errors_cancel=True))
    assert friction_known(replace(track, stated=(JointPhysics(friction=0.1),) * 6))
    seen = (np.abs(off).max(axis=0) > 0.1) & (np.array(list(ramps().values())) > 0.004)  # shorter ones hardly act
    assert seen.sum() >= 4
    left = off - 0.5 * found
    assert ((left**2).sum(axis=0) < 0.2 * (off**2).sum(axis=0))[seen].all()
    fast = np.abs(track.velocity) > 0.45
    assert np.abs(found[fast]).max() < 1e-9


def test_a_model_of_soft_friction_beside_bristles_is_a_difference_of_reversals() -> None:
    """MuJoCo's friction loss is soft in speed with a lead; that of a drive reverses along a path."""
    at, effect = effort_world(), effect_named("coulomb_friction")
    torques = {f"torque_{i}": f for i, f in enumerate(FRICTION, 1)}
    engine = torques | ramps() | {"law": SOFT, "lead": LEAD}
    drive = torques | {f"presliding_{i}": 1e-3 for i in range(1, 7)} | {"law": PRESLIDING}
    off = effect.simulate(at, filled(effect, at, drive)) - effect.simulate(at, filled(effect, at, engine))
    stated = tuple(JointPhysics(friction=f, ramp=ramp) for f, ramp in zip(FRICTION, ramps().values(), strict=True))
    found = reversal_columns(replace(at.effort, measured=at.effort.prediction + off, stated=stated))
    seen = np.abs(off).max(axis=0) > 0.1
    assert seen.sum() >= 4
    assert (((off - 0.5 * found) ** 2).sum(axis=0) < 0.25 * (off**2).sum(axis=0))[seen].all()


def test_a_motion_as_slow_as_the_reversal_of_the_model_shows_no_other_physics() -> None:
    """An arm that creeps: bristles reverse along 0.2 mrad, the model's friction within some mrad/s."""
    at, effect = effort_world(), effect_named("coulomb_friction")
    slow = replace(at.effort, velocity=0.02 * at.effort.velocity, acceleration=4e-4 * at.effort.acceleration)
    at = replace(at, effort=slow)
    torques = {f"torque_{i}": f for i, f in enumerate(FRICTION, 1)}
    drive = torques | {f"presliding_{i}": 2e-4 for i in range(1, 7)} | {"law": PRESLIDING}
    off = effect.simulate(at, filled(effect, at, drive)) - FRICTION * np.tanh(slow.velocity / 0.005)
    stated = tuple(JointPhysics(friction=f) for f in FRICTION)
    noise = 0.02 * np.random.default_rng(4).normal(size=off.shape) * FRICTION
    measured = slow.prediction + off + 0.005 * slow.rigid + noise
    found = reversal_columns(replace(slow, measured=measured, stated=stated))
    assert (((off - 0.5 * found) ** 2).sum(axis=0) < 0.1 * (off**2).sum(axis=0)).all()


def test_stiction_is_no_difference_of_reversals() -> None:
    """6 N m of stiction below 0.08 rad/s, beside 5 N m of sharp friction that the model states, was `none`."""
    at, effect = effort_world(), effect_named("stribeck_friction")
    stiction = {"velocity": 0.08} | {f"stiction_{i}": 1.2 * f for i, f in enumerate(FRICTION, 1)}
    off = effect.simulate(at, filled(effect, at, stiction))
    track = replace(at.effort, measured=at.effort.prediction + off)
    found = reversal_columns(replace(track, stated=tuple(JointPhysics(friction=f) for f in FRICTION)))
    assert (((off - 0.5 * found) ** 2).sum(axis=0) > 0.3 * (off**2).sum(axis=0)).all()


def test_the_law_of_engines_is_tried_after_all_others() -> None:
    """Its ramps can imitate other effects of a real drive: the UR10 of benchmarks.real lost links and damping."""
    at, effect = effort_world(), effect_named("coulomb_friction")
    starts = list(effect.starts(at, at.effort.measured - at.effort.prediction))
    assert [effect.general_at(start) for start in starts] == [False] * (len(starts) - 1) + [True]


def test_reversals_belong_to_the_prediction_of_their_problem() -> None:
    at = effort_world()
    track = replace(at.effort, errors_cancel=True)
    soft = np.tanh(track.velocity / 0.02) - np.tanh(track.velocity / 0.1)
    recorded = replace(at, effort=replace(track, measured=track.prediction + soft))
    other = recorded.with_effort(track.prediction + soft)
    columns = {}
    for name, each in (("soft", recorded), ("equal", other)):
        problem = effort_problem(each, NominalModel())
        columns[name] = next(group for group in problem.groups(problem.recorded) if group.name == "reversals").values
    assert np.abs(columns["soft"]).max() > 0.1
    assert np.abs(columns["equal"]).max() < 1e-9
