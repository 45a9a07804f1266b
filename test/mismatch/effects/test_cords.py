"""Cords that pull the tool: where the search for one begins, and what may act as one."""

import numpy as np
import pytest
from effect_worlds import recorded as world

from poise.mismatch.effects import Effect, Values, effect_named
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


def cable() -> Effect:
    found = effect_named("cable")
    assert found is not None
    return found


def cord(recorded: RecordedMotion, way: Array, slack: float, damping_time: float = 0.05) -> dict[str, float]:
    """A cord to an anchor a way (3,) m from the middle of the path, taut where it is longer than a share of its range.

    Args:
        slack: of the samples, negative: it is always taut. damping_time: s.
    """
    anchor, hook = recorded.position_in_world.mean(axis=0) + way, np.array([0.02, -0.03, 0.15])
    place = recorded.position_in_world + recorded.rotation_world_sensor @ hook
    length = np.linalg.norm(anchor - place, axis=1)
    rest = float(np.quantile(length, max(slack, 0.0))) + min(slack, 0.0) * float(np.ptp(length))
    values = {p.name: 0.0 for p in cable().parameters(recorded)}
    values |= dict(zip(("anchor_x", "anchor_y", "anchor_z"), anchor.tolist(), strict=True))
    values |= dict(zip("xyz", hook.tolist(), strict=True))
    return values | {"rest_length": rest, "damping_time": damping_time, "stiffness": 30.0}


def explained(recorded: RecordedMotion, wrench: Array, start: Values) -> float:
    """Share of the energy of a wrench (N, 6), less its mean, that a cord from a start explains with its best force."""
    level = wrench.std(axis=0) + 1e-9
    pull = (cable().columns(recorded, start)[:, :, 0] / level).ravel()
    wanted = (wrench / level).ravel()
    return float(pull @ wanted) ** 2 / max(float(pull @ pull) * float(wanted @ wanted), 1e-300)


@pytest.mark.parametrize("damping_time", [0.001, 0.5, 30.0])
def test_the_search_begins_near_the_cord_wherever_it_is_anchored(damping_time: float) -> None:
    recorded, rng = world(), np.random.default_rng(5)
    found = []
    for _ in range(8):
        way = rng.normal(size=3)
        values = cord(recorded, way / np.linalg.norm(way) * rng.uniform(0.7, 1.5), rng.uniform(-0.2, 0.4), damping_time)
        wrench = cable().simulate(recorded, values)
        noisy = wrench + 0.05 * wrench.std(axis=0) * rng.normal(size=wrench.shape)
        found.append(max(explained(recorded, wrench, start) for start in cable().starts(recorded, noisy)))
    assert min(found) > 0.9


@pytest.mark.parametrize(
    ("slack", "twins", "why"), [(0.4, (), ""), (0.85, ("contact",), ""), (0.95, ("contact",), "as a contact")]
)
def test_a_cord_that_is_hardly_ever_taut_may_be_a_contact(slack: float, twins: tuple[str, ...], why: str) -> None:
    recorded = world()
    values = cord(recorded, np.array([0.3, 0.4, 1.2]), slack, 0.001)
    assert cable().twins(recorded, values) == twins
    assert why in cable().implausible(recorded, values)
    assert bool(cable().implausible(recorded, values)) == bool(why)
