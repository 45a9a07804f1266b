"""One placement by one planner, and all that is measured of it."""

import time
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.assembly.models.limit import limit
from poise.assembly.statics.deadline import NO_DEADLINE
from poise.assembly.statics.pushes import Loads
from poise.baselines.placement.engine import Engine, holds
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about
from poise.placement import PLACEMENT_PLANNERS, Options, Placement, Uncertainty
from poise.types import Array

STILL = 1e-3
"""m: a corner that moves less in two seconds is at rest."""
SHIFT, LEAN, ROUGHNESS = 2e-3, np.radians(2.0), 0.2
NAN = float("nan")


@dataclass(frozen=True)
class Trial:
    """What came of one run.

    Args:
        scene, planner, seed: which.
        seconds: of processor time until the placement was known; judging it is part of Poise's own planning.
        attempts: poses tried.
        wrench: N, the weakest of twelve wrenches on any object (moments counted as forces at its radius).
        least, volume: see `poise.placement.PlacementScore`.
        moved: m, in MuJoCo, in two seconds; infinite when it fell.
        shaken: the same with errors of pose and friction.
        why: when there is no placement.
    """

    scene: str
    planner: str
    seed: int
    seconds: float
    attempts: int = 0
    wrench: float = NAN
    least: float = NAN
    volume: float = NAN
    moved: float = NAN
    shaken: float = NAN
    why: dict[str, int] = field(default_factory=dict)

    @property
    def success(self) -> bool:
        return not np.isnan(self.least)


def run(scene: str, assembly: Assembly, item: RigidObject, planner: str, seed: int, options: Options) -> Trial:
    """Plan and check one placement; `robust` is Poise asked for a placement that survives errors."""
    robust = planner == "robust"
    if robust:
        options = replace(options, uncertainty=Uncertainty())
    wall, processor = time.perf_counter(), time.process_time()
    try:
        found = PLACEMENT_PLANNERS.find("poise" if robust else planner).plan(assembly, item, options, seed, None)
    except PoiseError as error:
        seconds = time.process_time() - processor
        return Trial(scene, planner, seed, seconds, why={**error.data.get("rejected", {}), error.code.name: 1})
    # Others share this machine: of the planner's own clock, the share that this process had of the processor.
    share = (time.process_time() - processor) / (time.perf_counter() - wall)
    there = found.analysis.assembly
    return Trial(
        scene,
        planner,
        seed,
        found.seconds * share,
        found.iterations,
        weakest_wrench(found.analysis),
        found.score.least,
        found.score.volume,
        holds(there),
        shaken(found, seed) if robust else NAN,
    )


def weakest_wrench(analysis: Analysis) -> float:
    """N (Maeda et al. 2009): the least of a force or moment along any axis, either way, on any object that moves it."""
    questions, places = [], []
    for place in analysis.structure.movable:
        item = analysis.assembly.objects[place]
        com = item.com_in_world
        arm = float(np.linalg.norm(item.vertices - com, axis=1).max())
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            questions += [np.concatenate([axis, np.cross(com, axis)]), np.concatenate([np.zeros(3), arm * axis])]
            places += [place, place]
    count = len(places)
    return float(
        limit(analysis, Loads(np.arange(count), np.array(places), np.array(questions), count), NO_DEADLINE).lower.min()
    )


def shaken(found: Placement, seed: int) -> float:
    """m moved in two seconds, put down with errors at the limits asked for.

    The object is shifted 2 mm and leans 2 degrees, both some way, and is let down gently; friction is 20 % off.
    """
    rng = np.random.default_rng([seed, 7])
    assembly, item = found.analysis.assembly, found.item
    heading, bearing = rng.uniform(0, 2 * np.pi, 2)
    lean = rotation_about(np.array([np.cos(heading), np.sin(heading), 0.0]), LEAN)
    com = item.com_in_world
    reach = float(np.linalg.norm(item.vertices - com, axis=1).max())
    shift = np.array([SHIFT * np.cos(bearing), SHIFT * np.sin(bearing), LEAN * reach])
    pose = Pose(lean @ item.pose.rotation, lean @ (item.pose.translation - com) + com + shift)
    friction = assembly.friction * (1 + ROUGHNESS * rng.choice([-1.0, 1.0]))
    return let_down(assembly, item.id, pose, friction)


def let_down(assembly: Assembly, name: str, pose: Pose, friction: float) -> float:
    """m that any corner moves in two seconds after an object was let go of at a pose, gently; infinite if it fell."""
    engine = Engine(assembly, 1e-3, friction, damping=20.0)
    planned = engine.poses
    engine.put(name, pose, np.zeros(3))
    engine.run(1.0)
    if engine.moved(planned) > 10 * SHIFT:
        return float("inf")
    engine.calm(0.0)
    settled = engine.poses
    engine.run(2.0)
    return engine.moved(settled)


def mean(values: Array) -> float:
    """Without what is NaN; NaN when nothing is left."""
    kept = np.asarray(values, dtype=float)
    kept = kept[~np.isnan(kept)]
    return float(kept.mean()) if len(kept) else NAN
