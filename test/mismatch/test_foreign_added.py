"""The effects that the foreign benchmark gained later: springs, offsets and links against closed forms, their seeds."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.foreign.added import ADDED, EffortOffset, LinkParameters, SeriesElasticity
from benchmarks.foreign.load import random_load
from benchmarks.foreign.motions import MOTIONS
from benchmarks.foreign.plan import plans
from benchmarks.foreign.robots import ROBOTS
from benchmarks.foreign.world import Scene, World


def scene(robot: str, seconds: float) -> Scene:
    rng = np.random.default_rng(5)
    load = random_load(*ROBOTS[robot].payload, rng)
    return Scene(ROBOTS[robot], load, MOTIONS["multi_sine"](ROBOTS[robot], seconds, rng))


def test_a_link_behind_a_spring_turns_by_the_torque_over_the_stiffness() -> None:
    """At rest the motor is where it was; the pull of the spring is what the stiff robot needs at the link's angle."""
    what = scene("one_axis", 3.2)
    truth = {"scale": [1.0], "joint": 0, "large": 2.0, "moved": 0.1, "ratio": 0.3}
    spring = SeriesElasticity(0.02, truth)
    world = World(what, [spring])
    address = world.model.joint("bend").qposadr[0]
    world.run()
    bend = float(world.data.qpos[address])
    pull = float(world.data.qfrc_passive[world.model.joint("bend").dofadr[0]])
    damped = spring.stiffness * bend + float(world.model.joint("bend").damping[0]) * float(world.data.qvel[-1])
    assert spring.stiffness == pytest.approx(100.0)
    assert pull == pytest.approx(-damped, rel=0.05, abs=1e-3)


def test_an_offset_of_efforts_is_added_and_link_errors_change_them() -> None:
    what = scene("fr3", 1.5)
    healthy = World(what).run()
    count = len(what.robot.joints)
    offset = EffortOffset(0.5, {"scale": list(range(1, count + 1)), "joint": 0})
    shifted = World(what, [offset]).run().effort - healthy.effort
    np.testing.assert_allclose(shifted, np.broadcast_to(0.5 * np.arange(1, count + 1), shifted.shape), atol=1e-9)
    links = {"links": ["fr3_link4"], "shift": [[0.0, 0.0, 0.0]], "gain": [1.0]}
    heavier = World(what, [LinkParameters(0.3, {"scale": [1.0] * count, "joint": 0} | links)])
    assert heavier.model.body("fr3_link4").mass[0] == pytest.approx(1.3 * World(what).model.body("fr3_link4").mass[0])


def test_the_added_effects_have_seeds_of_their_own() -> None:
    added = list(plans("added_dev", 12))
    assert {plan.kind for plan in added} == {"single"}
    assert {name for plan in added for name in plan.candidates} == {fault.name for fault in ADDED}
    assert not {fault.name for fault in ADDED} & {name for plan in plans("dev", 60) for name in plan.candidates}


def test_nothing_is_wrong_in_the_healthy_sets() -> None:
    healthy = list(plans("healthy_dev", 12))
    assert {(plan.kind, plan.strength, plan.candidates) for plan in healthy} == {("healthy", 0.0, ())}
    assert len({plan.profile for plan in healthy}) > 5
