"""How likely a push moves something when friction, masses and poses are not known exactly."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly.contact import Structure
from poise.assembly.scene import Assembly, RigidObject
from poise.assembly.statics import Analysis, BlockAnalysis, Deadline, Mechanism, PatchMechanism, Push, loads_of
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.threads import in_one_thread
from poise.types import Array, Indices

# Number of samples of the masses for each draw of friction and poses.
_MASSES_PER_DRAW = 20
# After this many solved samples in a row that stand, in order of criticality, the rest counts as standing.
_SURE = 8


@dataclass(frozen=True)
class MotionProbability:
    """How likely something moves.

    Args:
        probability: that anything does.
        deviation: its standard deviation, of the sampling.
        moves: probability for each id that it does.
        samples: how many were drawn.
        solves: conic programs that took.
        complete: all samples were drawn before the deadline.
    """

    probability: float
    deviation: float
    moves: dict[str, float]
    samples: int
    solves: int
    complete: bool


@in_one_thread
def motion_probability(
    assembly: Assembly,
    push: Push,
    force: float,
    rng: np.random.Generator,
    samples: int = 2000,
    friction_deviation: float = 0.0,
    pose_deviation: float = 0.0,
    deadline: float | None = None,
) -> MotionProbability:
    """How likely a push of a given force moves something.

    Samples stand if they do so under model `default`: by limit analysis, uniform pressure and elastic contacts.
    Masses and centres of mass are drawn from the covariances of the objects; friction from the deviations of its
    pairs. Samples that differ in mass alone share their collapse mechanisms: a mechanism that takes less power
    against the sample's gravity than the push gives proves motion, and only the samples nearest to it are solved.

    Args:
        assembly: with covariances and deviations.
        push: where and along which direction.
        force: N.
        rng: of the samples.
        samples: how many.
        friction_deviation: of the coefficients of pairs without a deviation; 0: that of the assembly.
        pose_deviation: of each coordinate of each movable object's position across gravity, m.
        deadline: s; what was drawn by then counts.

    Raises:
        InputError: BAD_INPUT for numbers below 0; as `assess`.
        NoAnswerError: SOLVER_FAILED; DEADLINE when it left no time for a single sample.
    """
    _check(force=force, friction_deviation=friction_deviation, pose_deviation=pose_deviation)
    clock = Deadline.after(deadline)
    nominal = Structure.of(replace(assembly, friction_deviation=friction_deviation or assembly.friction_deviation))
    # Draws of friction and poses are new problems; masses within one are not.
    masses = _MASSES_PER_DRAW if any(item.covariance is not None for item in assembly.objects) else 1
    each = masses if friction_varies(nominal.assembly) or pose_deviation > 0 else samples
    counts: Counter[str] = Counter()
    moved = drawn = solves = 0
    while drawn < samples and not clock.passed:
        structure = _shifted(nominal, pose_deviation, rng) if pose_deviation > 0 else nominal
        if friction_varies(nominal.assembly):
            structure = with_friction_drawn(structure, rng)
        movers, used = _moves(Analysis(structure), push, force, rng, min(each, samples - drawn), clock)
        drawn, solves = drawn + len(movers), solves + used
        moved += sum(mechanism is not None for mechanism in movers)
        for mechanism in filter(None, movers):
            counts.update(assembly.objects[place].id for place in mechanism.velocities)
    return _tallied(counts, moved, drawn, samples, solves)


def _tallied(counts: Counter[str], moved: int, drawn: int, samples: int, solves: int) -> MotionProbability:
    if not drawn:
        raise NoAnswerError(ErrorCode.DEADLINE, "no time was left for a single sample; give a longer deadline")
    share = moved / drawn
    deviation = float(np.sqrt(share * (1 - share) / drawn))
    moves = {name: count / drawn for name, count in counts.items()}
    return MotionProbability(share, deviation, moves, drawn, solves, drawn >= samples)


def _check(**settings: float) -> None:
    for name, value in settings.items():
        if not (np.isfinite(value) and value >= 0):
            raise InputError(ErrorCode.BAD_INPUT, f"{name} is {value}, expected a number that is not negative")


def _shifted(structure: Structure, deviation: float, rng: np.random.Generator) -> Structure:
    """The structure with its objects moved a little; contacts may gap or overlap by as much as that may be."""
    assembly = structure.assembly
    down = np.asarray(assembly.gravity) / (np.linalg.norm(assembly.gravity) or 1.0)
    objects = []
    for item in assembly.objects:
        if not item.fixed:
            step = rng.normal(0.0, deviation, 3)
            step -= (step @ down) * down
            item = replace(item, pose=Pose(item.pose.rotation, item.pose.translation + step))
        objects.append(item)
    return Structure.of(replace(assembly, objects=tuple(objects)), structure.margin + 6 * deviation)


def friction_varies(assembly: Assembly) -> bool:
    """Whether a deviation of friction is stated."""
    return assembly.friction_deviation > 0 or any(pair.deviation > 0 for pair in assembly.friction_pairs)


def with_friction_drawn(structure: Structure, rng: np.random.Generator) -> Structure:
    """The structure with the coefficients of all interfaces drawn again, one per pair of objects."""
    objects = structure.assembly.objects
    deviations = {frozenset(pair.objects): pair.deviation for pair in structure.assembly.friction_pairs}
    drawn: dict[tuple[int, int], float] = {}
    interfaces = []
    for interface in structure.interfaces:
        key = interface.first, interface.second
        if key not in drawn:
            names = frozenset((objects[key[0]].id, objects[key[1]].id))
            deviation = deviations.get(names, 0.0) or structure.assembly.friction_deviation
            drawn[key] = max(0.0, float(rng.normal(interface.friction, deviation)))
        interfaces.append(replace(interface, friction=drawn[key]))
    return replace(structure, interfaces=tuple(interfaces))


def _moves(
    analysis: Analysis, push: Push, force: float, rng: np.random.Generator, count: int, deadline: Deadline
) -> tuple[list[Mechanism | None], int]:
    """How each of `count` samples of the masses moves (None: not at all), and how many programs were solved.

    After the deadline the samples that are left are dropped, those that move as well as those that stand.
    """
    loads = loads_of(analysis.assembly, [push], np.inf)
    moments = {
        place: drawn_moments(analysis.assembly.objects[place], rng, count) for place in analysis.structure.movable
    }
    movers: list[Mechanism | None] = [None] * count
    solves = 0
    for block in analysis.blocks:
        if block.solvers.balance.margin < 0:
            mechanism = Mechanism(block, block.solvers.balance.twist)
            return [mechanism] * count, solves
        _, pushes = block.loads(loads)
        pushed = force * pushes[0] if len(pushes) else np.zeros(6 * block.geometry.count)
        change = _gravity(block, moments, count) - block.geometry.gravity.ravel() + pushed
        twists, used = _falls(block, change)
        solves += used
        found = {row: Mechanism(block, twist) for row, twist in twists.items()}
        standing = np.array([row for row in range(len(movers)) if movers[row] is None and row not in found], dtype=int)
        found |= _patch_collapses(block, change, standing)
        yielding, reached = _elastic_falls(block, change, standing, deadline)
        movers = [known or found.get(row) or yielding.get(row) for row, known in enumerate(movers[:reached])]
    return movers, solves


def _patch_collapses(block: BlockAnalysis, change: Array, rows: Indices) -> dict[int, Mechanism]:
    """Which samples (rows) of one body on one interface, as `_falls` takes them, a patch does not sustain."""
    single = block.solvers.single_patch
    if single is None:
        return {}
    wrenches = block.geometry.units.wrench(change[rows])
    found = single.collapse(wrenches)
    return {
        int(rows[k]): PatchMechanism(block, single, wrenches[k], float(found.factor[k]), bool(found.slips[k]))
        for k in np.flatnonzero(found.factor < 1).tolist()
    }


def _elastic_falls(
    block: BlockAnalysis, change: Array, rows: Indices, deadline: Deadline
) -> tuple[dict[int, Mechanism], int]:
    """Which samples (rows), as `_falls` takes them, elastic contacts do not hold where contact forces have a choice.

    Returns:
        How these move, and the number of the first sample that was not reached.
    """
    found: dict[int, Mechanism] = {}
    if block.geometry.statically_determinate:
        return found, len(change)
    gravity = block.geometry.gravity.ravel()
    settle = block.solvers.coulomb.settle
    rest = settle(gravity, deadline=deadline)
    start, still = (rest.displacement, rest.displacement) if rest.stands else (None, np.zeros_like(gravity))
    for row, before in zip(rows.tolist(), [None, *rows.tolist()], strict=False):
        if before is None or not np.array_equal(change[row], change[before]):
            state = settle(gravity + change[row], start, deadline)
        if not state.known:
            return found, row
        if state.stands:
            start = state.displacement
        else:
            found[row] = Mechanism(block, state.displacement - still)
    return found, len(change)


def _falls(block: BlockAnalysis, change: Array) -> tuple[dict[int, Array], int]:
    """Which samples of the load, as changes (S, 6 n) of the block's gravity, it does not sustain, and how it moves."""
    count = len(change)
    twists: list[Array] = []
    power = np.zeros(count)
    best = np.full(count, -1)
    known = np.zeros(count, dtype=bool)
    in_a_row = 0
    while not known.all() and in_a_row < _SURE:
        open_rows = np.flatnonzero(~known & (power <= 1))
        if not len(open_rows):
            break
        row = int(open_rows[power[open_rows].argmax()])
        inverse = block.solvers.limit.inverse_factor(change[row])
        known[row] = True
        in_a_row = 0 if inverse.value > 1 else in_a_row + 1
        # A motion that nothing resists, not even gravity, weighs more than any power.
        twist = inverse.twist * (1e9 if np.isinf(inverse.value) else 1.0)
        twists.append(twist)
        found = change @ twist
        better = found > power
        power[better], best[better] = found[better], len(twists) - 1
    return {row: twists[best[row]] for row in np.flatnonzero(power > 1).tolist()}, len(twists)


def drawn_moments(item: RigidObject, rng: np.random.Generator, count: int) -> Array:
    """(count, 4) mass and mass times centre of mass (in the object frame), drawn from the covariance."""
    com = item.pose.undo(item.com_in_world)
    mean = np.concatenate([[item.mass], item.mass * com])
    if item.covariance is None:
        return np.broadcast_to(mean, (count, 4))
    drawn = rng.multivariate_normal(mean, np.asarray(item.covariance)[:4, :4], size=count)
    drawn[:, 0] = np.maximum(drawn[:, 0], 1e-9)
    return np.asarray(drawn)


def _gravity(block: BlockAnalysis, moments: dict[int, Array], count: int) -> Array:
    """(count, 6 n) load of gravity on a block, in its units, for samples of the masses; linear in these."""
    assembly = block.structure.assembly
    gravity = np.asarray(assembly.gravity)
    total = np.zeros((count, block.geometry.count, 6))
    for place, body in block.body_of.items():
        pose = assembly.objects[place].pose
        mass = moments[place][:, :1]
        first = moments[place][:, 1:] @ pose.rotation.T + mass * pose.translation
        wrench = np.concatenate([mass * gravity, np.cross(first, gravity)], axis=1)
        total[:, body] += block.geometry.units.of_wrench(wrench)
    return total.reshape(count, -1)
