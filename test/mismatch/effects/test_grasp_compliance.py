"""A payload that turns in its grip, about all axes or about one."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import HOME, NOISE, PAYLOAD, recorded
from scipy.spatial.transform import Rotation
from test_load_effects import DOWN, agree, at_rest, fine, in_world, rate, response

from poise.inertia.model.parameters import symmetric
from poise.mismatch.effects import effect_named, grasp_compliance
from poise.mismatch.effects.grasp_compliance import _Turned
from poise.mismatch.effects.part_wrench import chart, direction
from poise.mismatch.inference import names, search, wrench_problem
from poise.mismatch.reading import NominalModel

HINGE = np.array([0.36, 0.48, 0.8])


def test_the_search_for_a_soft_grasp_is_not_misled_by_errors_of_calibration():
    """A bias, gains and a shifted centre of mass explain more of the wrench than the payload that turns."""
    at = recorded(jitter=0.0)
    turned = response("grasp_compliance", at, stiffness=90.0, damping_ratio=0.2, height=0.01)
    errors = np.array([0.3, -0.2, 0.4, 0.02, -0.02, 0.01]) + at.nominal * [0.01, -0.01, 0.008, 0.01, -0.01, 0.01]
    errors[:, 3:] += np.cross([0.01, -0.006, 0.008], at.specific)
    noise = np.random.default_rng(5).normal(size=turned.shape) * np.repeat([0.1, 0.005], 3)
    assert np.linalg.norm(errors) > np.linalg.norm(turned)
    start, _ = effect_named("grasp_compliance").starts(at, turned + errors + noise)
    assert 45.0 < start["stiffness"] < 180.0


@pytest.mark.parametrize(("stiffness", "axis"), [(25.0, [0.0, 1.0, 0.0]), (120.0, [0.9, -0.3, 0.3])])
def test_the_search_for_a_hinge_begins_near_its_axis(stiffness, axis):
    at = recorded(jitter=0.0)
    values = {"stiffness": stiffness, "damping_ratio": 0.15, "height": 0.02, "axes": 1.0, **chart(axis)}
    noise = np.random.default_rng(5).normal(size=(len(at), 6)) * NOISE
    _, start = effect_named("grasp_compliance").starts(at, response("grasp_compliance", at, **values) + noise)
    assert abs(direction(start) @ direction(values)) > np.cos(0.6)
    assert 0.5 * stiffness < start["stiffness"] < 2.0 * stiffness


def test_a_grip_that_gives_about_one_axis_is_no_flexible_mode():
    """A hinge at the grip was `flexible_mode` (99.5 %): its mode has two thirds of the payload's mass."""
    at, grasp = recorded("poses"), effect_named("grasp_compliance")
    values = {"stiffness": 30.0, "damping_ratio": 0.15, "height": 0.02, "axes": 1.0, **chart([0.3, 1.0, 0.1])}
    noise = np.random.default_rng(8).normal(size=at.wrench.shape) * NOISE
    problem = wrench_problem(
        replace(at, wrench=at.prediction + grasp.simulate(at, values) + noise), NominalModel(phi=at.phi)
    )
    _, best = search(problem, [grasp, effect_named("flexible_mode")])
    assert names(best) == ("grasp_compliance",)
    (part,) = best.parts
    assert part.values["axes"] == 1.0
    assert part.values["stiffness"] == pytest.approx(30.0, rel=0.05)


@pytest.mark.parametrize("law", [{}, {"axes": 1.0, **chart(HINGE)}], ids=["all axes", "hinge"])
@pytest.mark.parametrize("stiffness", [40.0, 300.0])
def test_a_payload_in_a_soft_grip_moves_by_the_laws_of_momentum(stiffness, law):
    """Its turn is given; force and torque are then the change of its linear and angular momentum in the world."""
    at, height = fine(), 0.03
    values = {"stiffness": stiffness, "damping_ratio": 0.2, "height": height, **law}
    found = at.prediction + effect_named("grasp_compliance").simulate(at, values)
    turn, _, _ = _Turned(at, values["height"]).turns(values)
    pivot = np.array([0.0, 0.0, height])
    rotation = at.rotation_world_sensor @ Rotation.from_rotvec(turn).as_matrix()
    to_centre = np.einsum("nij,j->ni", rotation, PAYLOAD.com - pivot)
    centre = at.position_in_world + in_world(at, pivot) + to_centre
    spin = _spin(at, rotation)
    momentum = np.einsum("nij,jk,nlk,nl->ni", rotation, PAYLOAD.inertia, rotation, spin)
    force = PAYLOAD.mass * (DOWN - rate(at, centre, 2))
    torque = np.cross(centre - at.position_in_world, force) - rate(at, momentum)
    exact = np.hstack([np.einsum("nji,nj->ni", at.rotation_world_sensor, part) for part in (force, torque)])
    agree(found, exact, share=1e-2)
    # The springs hold what the payload asks of them: k theta + c theta' = torque about the pivot.
    about = found[:, 3:] - np.cross(pivot, found[:, :3])
    shift = 2 * height * PAYLOAD.phi[3] - PAYLOAD.mass * height**2
    inertia = symmetric(PAYLOAD.phi[4:]) - shift * np.diag([1.0, 1.0, 0.0])
    inertia[:2, 2] += height * PAYLOAD.phi[1:3]
    inertia[2, :2] += height * PAYLOAD.phi[1:3]
    held = stiffness * turn + 2 * 0.2 * rate(at, turn) * np.sqrt(stiffness * inertia[0, 0])
    if not law:
        agree(held, about, share=2e-2)
        return
    # A hinge leaves the rest of the torque to its bearing.
    np.testing.assert_allclose(np.cross(turn, HINGE), 0.0, atol=1e-12)
    along = stiffness * turn + 2 * 0.2 * rate(at, turn) * np.sqrt(stiffness * (HINGE @ inertia @ HINGE))
    agree((along @ HINGE)[:, None], (about @ HINGE)[:, None], share=2e-2)


def _spin(at, rotation):
    """(N, 3) angular velocity in the world of (N, 3, 3), by differences of its entries."""
    change = rate(at, rotation.reshape(len(rotation), 9)).reshape(-1, 3, 3) @ rotation.swapaxes(1, 2)
    return np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)


def test_a_soft_grip_at_rest_sags_until_the_spring_holds_the_weight():
    at, stiffness = at_rest(duration=1.0, pose=HOME + 0.3), 30.0
    values = {"stiffness": stiffness, "damping_ratio": 0.2, "height": 0.0}
    turn, _, _ = _Turned(at, values["height"]).turns(values)
    lever = Rotation.from_rotvec(turn[0]).as_matrix() @ PAYLOAD.com
    np.testing.assert_allclose(stiffness * turn[0], np.cross(lever, PAYLOAD.mass * at.gravity[0]), atol=2e-3)


def test_a_stiffer_grip_gives_way_less_in_proportion():
    values = {"damping_ratio": 0.5, "height": 0.0}
    stiff, soft = (
        effect_named("grasp_compliance").simulate(fine(), values | {"stiffness": k})[200:] for k in (4000.0, 400.0)
    )
    np.testing.assert_allclose(10 * stiff, soft, atol=0.05 * np.abs(soft).max())


@pytest.mark.parametrize("law", [{}, {"axes": 1.0, **chart(HINGE)}], ids=["all axes", "hinge"])
def test_a_payload_turns_in_compiled_code_as_in_python(law, monkeypatch):
    at, found = recorded(), []
    for compiled in (True, False):
        monkeypatch.setattr(grasp_compliance, "COMPILED", compiled)
        found.append(response("grasp_compliance", at, stiffness=20.0, damping_ratio=0.1, height=0.02, **law))
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-11)


def test_about_an_axis_without_inertia_no_hinge_begins():
    """A point mass on the sensor's z axis: its resonance about z had a stiffness of nothing, and a fit without end."""
    point = np.array([0.9, 0.0, 0.0, 0.04, 0.0014, 0.0, 0.0, 0.0014, 0.0, 0.0])
    at = replace(recorded(jitter=0.0), phi=point)
    residual = np.random.default_rng(2).normal(size=(len(at), 6)) * NOISE
    effect = effect_named("grasp_compliance")
    for start in effect.starts(at, residual):
        assert 5.0 <= start["stiffness"] <= 5000.0
        assert np.isfinite(effect.simulate(at, start)).all()
