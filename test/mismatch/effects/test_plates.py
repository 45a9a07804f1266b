"""Contacts with a plate: the law of its force, and plates that are found where the tool comes back to them."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import NOISE, effort_world, filled, recorded

from poise.geometry import sphere_directions
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.part_wrench import beside_errors
from poise.mismatch.effects.plate import REFINED, depth_inside, inward, plate_slopes, plate_wrenches, touches
from poise.mismatch.reading.load_on_efforts import LoadOnEfforts
from poise.mismatch.recorded import joint_torques

CONTACT = effect_named("contact")
HOOK = np.array([0.02, -0.03, 0.15])


def plate(at, normal, depth, exponent=1.5, **pushes):
    """Values of a plate which a point of the tool enters by a depth, m, where it comes farthest along a normal."""
    path = at.position_in_world + at.rotation_world_sensor @ HOOK
    surface = path[int(np.argmax(path @ normal))] - depth * normal
    along = int(np.argmax(np.abs(normal)))
    axis = np.roll(normal, -along) / abs(normal[along])
    given = {"law": 1.0, "face": 2.0 * along + (normal[along] < 0.0), "tilt_u": axis[1], "tilt_v": axis[2]}
    given |= dict(zip(("surface_x", "surface_y", "surface_z"), surface, strict=True))
    given |= dict(zip("xyz", HOOK, strict=True))
    return filled(CONTACT, at, {"start": 0.0, "length": 1.0, "height": 0.0, "exponent": exponent, **given, **pushes})


def touched(at, apart=0.0):
    """A normal with which the tool touches twice or more, for a tenth of the time at the most."""
    for normal in sphere_directions(60):
        values = plate(at, normal, 0.02, press=1.4, rub=0.6)
        windows = touches(at, values)
        brief = np.mean(depth_inside(at, values) > 0.0) < 0.1
        long = [end - start for start, end in windows if end - start > 0.3]
        if brief and len(long) > 1 and windows[-1][0] - windows[0][1] > apart:
            return normal
    raise AssertionError("no plate is touched twice")


def test_a_plate_pushes_by_its_depth_and_rubs_against_the_sliding():
    at = recorded(jitter=0.0)
    normal = sphere_directions(17)[5]
    values = plate(at, normal, 0.03, press=1.8, rub=1.2)
    np.testing.assert_allclose(inward(values), normal, atol=1e-12)
    found = CONTACT.simulate(at, values)
    path = at.position_in_world + at.rotation_world_sensor @ HOOK
    depth = np.maximum(path @ normal - (path @ normal).max() + 0.03, 0.0)
    force = np.einsum("nij,nj->ni", at.rotation_world_sensor, found[:, :3])
    np.testing.assert_allclose(force @ normal, -3.0 * (depth / 0.01) ** 1.5, atol=1e-6)
    np.testing.assert_allclose(found[:, 3:], np.cross(HOOK, found[:, :3]), atol=1e-12)
    # Coulomb: against the velocity of the point along the surface, where it slides.
    velocity = np.gradient(path, at.seconds, axis=0)
    level = velocity - np.outer(velocity @ normal, normal)
    slides = (depth > 1e-3) & (np.linalg.norm(level, axis=1) > 0.05)
    assert slides.sum() > 20
    rubs = force - np.outer(force @ normal, normal)
    against = -np.einsum("ni,ni->n", rubs, level)[slides] / np.linalg.norm(level, axis=1)[slides]
    np.testing.assert_allclose(against, 0.4 * np.abs(force @ normal)[slides], rtol=0.02)
    assert [bool(found[k].any()) for k in range(len(at))] == (depth > 0.0).tolist()


def test_the_sentence_and_the_numbers_of_a_plate():
    at = recorded(jitter=0.0)
    values = plate(at, touched(at), 0.02, press=1.4, rub=0.6)
    derived = CONTACT.derived(at, values)
    assert derived["friction"][0] == pytest.approx(0.3)
    assert derived["depth"][0] == pytest.approx(0.02)
    assert derived["peak_force"][0] == pytest.approx(2.0 * 2.0**1.5 * np.hypot(1.0, 0.3), rel=0.05)
    (begin, end), *others = CONTACT.windows(at, values)
    said = f"pressed on a surface {1 + len(others)} times, first from {begin:.1f} s to {end:.1f} s: up to"
    assert said in CONTACT.sentence(at, values)
    assert CONTACT.implausible(at, values) == ""
    assert not CONTACT.free(values)
    assert "touch it for" in CONTACT.implausible(at, plate(at, touched(at), 0.15, press=2.0))
    assert "pull" in CONTACT.implausible(at, {**values, "damping": 60.0})


def test_slopes_of_a_plate_are_those_of_differences():
    at = recorded(jitter=0.0)
    values = plate(at, touched(at), 0.02, press=2.0, damping=0.2)
    sizes = np.array([2.0, 0.0, 0.0])
    found = plate_slopes(at, values, sizes)
    for k, name in enumerate(REFINED):
        ahead, back = (plate_wrenches(at, {**values, name: values[name] + step}) @ sizes for step in (1e-6, -1e-6))
        np.testing.assert_allclose(found[:, :, k], (ahead - back) / 2e-6, atol=2e-3 * np.abs(found[:, :, k]).max())


def on_plate(found):
    return [each for each in found if each["law"] == 1.0]


@pytest.mark.parametrize(("seed", "exponent"), [(2, 1.5), (3, 1.0)])
def test_a_plate_that_is_touched_again_is_found_through_noise(seed, exponent):
    at = recorded(jitter=0.0, seed=seed)
    values = plate(at, touched(at, 1.0), 0.02, exponent, press=1.4, rub=0.6)
    noise = np.random.default_rng(seed).normal(size=at.wrench.shape) * NOISE
    (found,) = on_plate(CONTACT.starts(at, beside_errors(at, CONTACT.simulate(at, values) + noise)))
    assert inward(found) @ inward(values) > 0.97
    inside, true = depth_inside(at, found) > 0.0, depth_inside(at, values) > 0.0
    assert np.sum(inside & true) > 0.7 * np.sum(inside | true)


def test_a_plate_is_found_in_joint_efforts():
    at = effort_world()
    values = plate(at, touched(at), 0.02, press=2.1, rub=0.9)
    alone = replace(at, wrench=np.full_like(at.wrench, np.nan))
    torque = joint_torques(at, CONTACT.simulate(at, values)[:, :, None])[:, :, 0]
    noise = np.random.default_rng(5).normal(size=torque.shape) * 0.05
    (found,) = on_plate(LoadOnEfforts(CONTACT).starts(alone, torque + noise))
    inside, true = depth_inside(at, found) > 0.0, depth_inside(at, values) > 0.0
    assert np.sum(inside & true) > 0.7 * np.sum(inside | true)


def test_noise_and_what_attracts_have_no_plate():
    """A magnet pulls where a plate pushes."""
    at = recorded(jitter=0.0)
    noise = np.random.default_rng(6).normal(size=at.wrench.shape) * NOISE
    assert not on_plate(CONTACT.starts(at, noise))
    path = at.position_in_world + at.rotation_world_sensor @ HOOK
    way = path[int(np.argmax(path @ touched(at)))] + 0.03 * touched(at) - path
    pull = 0.02 * way / np.linalg.norm(way, axis=1, keepdims=True) ** 3
    force = np.einsum("nji,nj->ni", at.rotation_world_sensor, np.minimum(pull, 20.0))
    found = on_plate(CONTACT.starts(at, np.hstack([force, np.cross(HOOK, force)]) + noise))
    normal = touched(at)
    assert all(inward(each) @ normal < 0.5 for each in found)
