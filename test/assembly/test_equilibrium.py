"""Contact forces, margins and self-stress, against statics by hand and a general solver."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, fixed_box, turned
from scipy.optimize import minimize

from poise.assembly import Analysis, Assembly
from poise.assembly.statics.equilibrium import contact_forces, stability
from poise.errors import ErrorCode, NoAnswerError


def block(assembly):
    return Analysis.of(assembly).blocks[0]


def slope(degrees, friction):
    angle = np.radians(degrees)
    quaternion = turned((0, 1, 0), degrees)
    ramp = fixed_box("ramp", (20, 20, 1), (0, 0, 0), quaternion)
    cube = box("cube", (1, 1, 1), (np.sin(angle), 0, np.cos(angle)), quaternion=quaternion)
    return Assembly((ramp, cube), scenes.GRAVITY, friction)


def test_a_cube_spreads_its_weight_evenly_over_its_corners():
    forces = contact_forces(block(scenes.cube()).geometry)
    np.testing.assert_allclose(forces[:, 0], 0.25, atol=1e-7)
    np.testing.assert_allclose(forces[:, 1:], 0, atol=1e-7)


@pytest.mark.parametrize("sides", [None, 4, 8])
def test_contact_forces_balance_every_body_within_their_cones(sides):
    geometry = block(scenes.table()).geometry
    forces = contact_forces(geometry, sides=sides)
    left = geometry.grasp @ forces.ravel() + geometry.gravity.ravel()
    np.testing.assert_allclose(left, 0, atol=1e-7)
    assert np.all(np.linalg.norm(forces[:, 1:], axis=1) <= geometry.friction * forces[:, 0] + 1e-7)


def test_contact_forces_have_the_least_sum_of_squares():
    """On a slope, against scipy's SLSQP on the same problem (thesis eq. 4.12-4.15)."""
    geometry = block(slope(15, 0.5)).geometry
    forces = contact_forces(geometry)
    grasp, load = geometry.grasp.toarray(), geometry.gravity.ravel()
    cone = {
        "type": "ineq",
        "fun": lambda f: geometry.friction * f.reshape(-1, 3)[:, 0] - np.hypot(*f.reshape(-1, 3)[:, 1:].T + 1e-12),
    }
    balance = {"type": "eq", "fun": lambda f: grasp @ f + load, "jac": lambda _: grasp}
    start, of_squares = forces.ravel() * 0.9, {"fun": lambda f: f @ f, "jac": lambda f: 2 * f}
    found = minimize(**of_squares, x0=start, constraints=[balance, cone], method="SLSQP", tol=1e-12)
    assert found.success
    assert (forces**2).sum() == pytest.approx(found.fun, rel=1e-6)


@pytest.mark.parametrize("sides", [4, 8, 16])
def test_a_polygon_holds_less_than_the_circle_and_more_the_more_sides_it_has(sides):
    """The inscribed polygon's apothem is mu cos(pi / N): a slope between the two distinguishes them."""
    tangent = 0.5 * np.cos(np.pi / sides)
    # Downhill along a tangent axis lies at the middle of a side when the polygon starts at a corner there.
    below = block(slope(np.degrees(np.arctan(0.99 * tangent)), 0.5)).geometry
    contact_forces(below, sides=sides)
    above = block(slope(np.degrees(np.arctan(0.5)) + 0.5, 0.5)).geometry
    for number in (sides, None):
        with pytest.raises(NoAnswerError) as caught:
            contact_forces(above, sides=number)
        assert caught.value.code is ErrorCode.UNSTABLE


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_the_margin_changes_sign_at_the_friction_angle(friction):
    limit = np.degrees(np.arctan(friction))
    assert stability(block(slope(limit - 0.1, friction)).geometry).margin > 1e-4
    assert stability(block(slope(limit, friction)).geometry).margin == 0
    assert stability(block(slope(limit + 0.1, friction)).geometry).margin < -1e-4


def test_the_margin_of_a_cube_is_its_weight_and_of_an_overhang_what_its_edge_can_spare():
    """The interface can press less by t if the rest, W - t shifted to one side, still balances: W (1 - 2 d)."""
    assert Analysis.of(scenes.cube()).stability().margin == pytest.approx(G)
    offset = 0.3
    shelf = fixed_box("shelf", (1, 1, 1), (0, 0, 0.5))
    over = Assembly((shelf, box("cube", (1, 1, 1), (0, 0, 1.5), com=np.array([offset, 0, 0]))), scenes.GRAVITY, 0.5)
    assert Analysis.of(over).stability().margin == pytest.approx(G * (1 - 2 * offset), rel=1e-6)


def test_an_assembly_that_falls_says_what_and_by_what_margin():
    table = fixed_box("table", (1, 1, 1), (0, 0, 0.5))
    assembly = Assembly(
        (table, box("safe", (0.2, 0.2, 0.2), (0, 0, 1.1)), box("over", (0.2, 0.2, 0.2), (0.55, 0, 1.1)))
    )
    with pytest.raises(NoAnswerError, match=r"over would move \(margin -") as caught:
        Analysis.of(assembly).require_stable()
    assert caught.value.code is ErrorCode.UNSTABLE
    assert caught.value.data["objects"] == ["over"]
    assert caught.value.data["margin"] < 0
