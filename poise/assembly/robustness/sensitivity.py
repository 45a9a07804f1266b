"""How robustness changes with everything it depends on: from the collapse mechanism of limit analysis."""

from dataclasses import dataclass, field

import numpy as np

from poise.assembly.robustness.assess import assess
from poise.assembly.robustness.block_answers import CHECKED_SHARE
from poise.assembly.scene import Assembly
from poise.assembly.statics import UNLIMITED, Analysis, BlockAnalysis, Deadline, InverseLoadFactor, Push, loads_of
from poise.geometry import wrench_of_force
from poise.threads import in_one_thread
from poise.types import Array


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The robustness of one push, and the derivatives of its limit load L under limit analysis.

    Args:
        robustness: N; the lower bound of model `default`, at most L.
        limit: N; L. It is inf where nothing collapses, and then all derivatives are 0.
        doubtful: the robustness is less than 98 % of L, or was not checked in time. Another collapse than that of
            limit analysis decides then, and the derivatives may be wrong.
        mass: N/kg for each object by id (those that do not matter are left out). Linear: masses times derivatives add
            up to L.
        com: (3,) N/m for each object by id, for moves of its centre of mass in the assembly's frame.
        friction: N for each pair of ids, per unit of its coefficient.
        point: (3,) N/m for moves of the pushed point.
        push: as asked.
    """

    robustness: float
    limit: float
    doubtful: bool
    mass: dict[str, float]
    com: dict[str, Array]
    friction: dict[tuple[str, str], float]
    point: Array
    push: Push
    _weakest: tuple[BlockAnalysis, InverseLoadFactor] | None = field(repr=False)

    def improvement(self, extra: Push) -> float:
        """Change of L, N, per N of another force that presses all the while (thesis eq. 4.30, 4.43, exactly).

        Positive where leaning on, or putting down a weight at, that point makes the assembly stronger.
        """
        if self._weakest is None:
            return 0.0
        block, inverse = self._weakest
        place = block.structure.assembly.place_of(extra.object)
        if place not in block.body_of:
            return 0.0
        direction = np.asarray(extra.direction, dtype=np.float64)
        wrench = wrench_of_force(direction / np.linalg.norm(direction), np.asarray(extra.point, dtype=np.float64))
        body = block.body_of[place]
        twist = inverse.twist.reshape(-1, 6)[body]
        return float(-self.limit * (twist @ block.geometry.units.of_wrench(wrench)))


@in_one_thread
def sensitivity(assembly: Assembly | Analysis, push: Push, deadline: float | None = None) -> Sensitivity:
    """The robustness of one push, and the derivatives of its limit load.

    By the envelope theorem they need no further solve: with the collapse mechanism y and the contact forces at
    collapse held, L (power of the push) = power against gravity + power of friction, term by term.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        push: where and along which direction.
        deadline: s; without time to check the robustness, it is what was confirmed by then, and doubtful.

    Raises:
        InputError: as `assess`.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    clock = Deadline.after(deadline)
    analysis = Analysis.of(assembly, deadline=clock)
    analysis.require_stable(clock)
    checked = assess(analysis, [push], deadline=deadline).results[0]
    loads = loads_of(analysis.assembly, [push], analysis.structure.margin)
    weakest: tuple[BlockAnalysis, InverseLoadFactor] | None = None
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        if len(questions):
            inverse = block.solvers.limit.inverse_factor(block_loads[0])
            if inverse.value > UNLIMITED * np.abs(block_loads[0]).max() and (
                weakest is None or inverse.value > weakest[1].value
            ):
                weakest = block, inverse
    limit = np.inf if weakest is None else 1 / weakest[1].value
    held = min(checked.lower, limit)
    doubtful = checked.doubtful or held < CHECKED_SHARE * limit
    if weakest is None or limit == 0:
        return Sensitivity(held, limit, doubtful, {}, {}, {}, np.zeros(3), push, None)
    block, inverse = weakest
    mass, com = _of_weights(block, inverse, limit)
    force = np.asarray(push.direction, dtype=np.float64)
    force = force / np.linalg.norm(force)
    body = block.body_of[int(loads.place[0])]
    spin = inverse.twist.reshape(-1, 6)[body, 3:] / (block.geometry.units.length * block.geometry.units.weight)
    point = -(limit**2) * np.cross(force, spin)
    friction = _of_friction(block, inverse, limit)
    return Sensitivity(held, limit, doubtful, mass, com, friction, point, push, weakest)


def _of_weights(
    block: BlockAnalysis, inverse: InverseLoadFactor, limit: float
) -> tuple[dict[str, float], dict[str, Array]]:
    objects, gravity = block.structure.assembly.objects, np.asarray(block.structure.assembly.gravity)
    units = block.geometry.units
    mass, com = {}, {}
    for twist, members in zip(inverse.twist.reshape(-1, 6), block.block.members, strict=True):
        for place in members:
            item = objects[place]
            per_mass = units.of_wrench(wrench_of_force(gravity, item.com_in_world))
            mass[item.id] = float(-limit * (twist @ per_mass))
            spin = twist[3:] / (units.length * units.weight)
            com[item.id] = -limit * np.cross(item.mass * gravity, spin)
    return mass, com


def _of_friction(block: BlockAnalysis, inverse: InverseLoadFactor, limit: float) -> dict[tuple[str, str], float]:
    """More friction by d mu holds a slipping corner by its normal force times its sliding speed."""
    geometry, objects = block.geometry, block.structure.assembly.objects
    if inverse.multipliers is None:
        return {}
    sliding = np.linalg.norm((geometry.grasp.T @ inverse.twist).reshape(-1, 3)[:, 1:], axis=1)
    power = np.bincount(geometry.interface, inverse.multipliers[1::3] * sliding, len(block.interfaces))
    found: dict[tuple[str, str], float] = {}
    for interface, value in zip(block.interfaces, power, strict=True):
        pair = objects[interface.first].id, objects[interface.second].id
        found[pair] = found.get(pair, 0.0) + float(limit**2 * value)
    return found
