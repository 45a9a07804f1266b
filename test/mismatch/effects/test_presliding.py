"""Dry friction that reverses along a distance, as bristles that bend: against an integration of Dahl's law."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import effort_world, filled
from scipy.integrate import solve_ivp

from poise.mismatch import diagnose
from poise.mismatch.answer import effects_called
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.joint_friction import PRESLIDING, likely_reversals
from poise.mismatch.reading import NominalModel
from poise.types import Array

FRICTION = (3.0, 4.0, 2.0, 0.8, 0.6, 0.4)
DISTANCES = (0.002, 0.004, 0.001, 0.003, 0.006, 0.0015)
VALUES = {"law": PRESLIDING} | {f"presliding_{i}": d for i, d in enumerate(DISTANCES, 1)}
VALUES |= {f"torque_{i}": f for i, f in enumerate(FRICTION, 1)}


def integrated(seconds: Array, velocity: Array, distance: float) -> Array:
    """(M,) y of dy/dt = (v - |v| y) / d, y = 0 at the first stamp."""

    def rate(time: float, y: Array) -> Array:
        speed = np.interp(time, seconds, velocity)
        return (speed - abs(speed) * y) / distance

    span = (seconds[0], seconds[-1])
    found = solve_ivp(rate, span, [0.0], t_eval=seconds, rtol=1e-6, atol=1e-8, max_step=0.004, method="LSODA")
    return np.asarray(found.y[0])


def test_the_law_of_bristles_is_dahls() -> None:
    at, effect = effort_world(duration=6.0), effect_named("coulomb_friction")
    found = effect.simulate(at, filled(effect, at, VALUES)) / FRICTION
    for joint, distance in enumerate(DISTANCES):
        exact = integrated(at.effort.seconds, at.effort.velocity[:, joint], distance)
        # A reversal lies between two stamps, where the path has no direction.
        assert np.mean((found[:, joint] - exact) ** 2) < 0.02**2
        assert np.quantile(np.abs(found[:, joint] - exact), 0.98) < 0.02


def test_its_start_finds_the_distances_beside_a_load() -> None:
    at, effect = effort_world(), effect_named("coulomb_friction")
    off = effect.simulate(at, filled(effect, at, VALUES)) + 0.03 * at.effort.rigid
    found = likely_reversals(at, off)[PRESLIDING]
    for i, distance in enumerate(DISTANCES, 1):
        assert found[f"presliding_{i}"] == pytest.approx(distance, rel=0.5)


def test_friction_with_presliding_is_named_and_explained() -> None:
    """Without this law, Coulomb friction had 0 % ("would have to vary with delay"), beside an unknown effect."""
    at, effect = effort_world(), effect_named("coulomb_friction")
    viscous = at.effort.velocity * (2.0, 2.0, 1.5, 0.4, 0.4, 0.2)
    noise = np.random.default_rng(4).normal(size=viscous.shape) * (0.2, 0.2, 0.2, 0.05, 0.05, 0.05)
    measured = at.effort.measured + effect.simulate(at, filled(effect, at, VALUES)) + viscous + noise
    seen = replace(at, wrench=np.full_like(at.wrench, np.nan), effort=replace(at.effort, measured=measured))
    library = effects_called(
        ["coulomb_friction", "viscous_friction", "stribeck_friction", "motor_inertia", "effort_offset", "backlash"]
    )
    found = diagnose(seen, NominalModel(phi=at.phi), library=library)
    assert found.verdict == "named"
    assert {each.effect.name for each in found.findings} == {"coulomb_friction", "viscous_friction"}
    assert found.main.proof.augmented < 1.05
    (dry,) = (each for each in found.findings if each.effect is effect)
    sizes = [dry.parameters[f"presliding_{i}"].value for i in range(1, 7)]
    assert sizes == pytest.approx(DISTANCES, rel=0.2)
    assert "transition" not in dry.parameters
