"""Which cases are made: profiles and effects in turn, from seeds that share no chance."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.foreign.added import ADDED
from benchmarks.foreign.drives import DRIVES, JointCoupling
from benchmarks.foreign.events import EVENTS
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.loads import LOADS
from benchmarks.foreign.outside import OUTSIDE
from benchmarks.foreign.profiles import PROFILES, Profile
from benchmarks.foreign.robots import ROBOTS, Robot
from benchmarks.foreign.sensors import SENSORS

SEEDS = {
    "dev": 7301,
    "calibration": 92551,
    "final": 641909,
    "added_dev": 55190,
    "added_final": 640231,
    "broken_final": 918364,
    "healthy_dev": 5510333,
    "healthy_final": 550267,
}
KINDS = ("healthy",) * 6 + ("single",) * 10 + ("pair",) * 2 + ("outside",) * 2
"""Of twenty cases; singles and effects outside the library have strength 1 and 0.3 in turn, pairs 1."""

ONLY_ADDED = ("added_dev", "added_final")
"""Sets of single effects among those that came later."""
ONLY_HEALTHY = ("healthy_dev", "healthy_final")
"""Sets in which nothing is wrong: false alarms are too rare for the few healthy cases of the others."""
LIBRARY: tuple[type[Fault], ...] = (*LOADS, *EVENTS, *SENSORS, *DRIVES)


@dataclass(frozen=True)
class Plan:
    """One case.

    Args:
        seed: of every chance in it. kind: healthy, single, pair or outside. profile: name.
        candidates: effects, by name, in the order in which they are tried until enough of them show.
        strength: 0, 0.3 or 1.
    """

    seed: tuple[int, int]
    kind: str
    profile: str
    candidates: tuple[str, ...]
    strength: float


def applicable(profile: Profile, robot: Robot, fault: type[Fault]) -> bool:
    """The profile of a robot records what the effect shows in."""
    if not {"wrench": profile.wrench, "effort": profile.effort, "any": True}[fault.needs]:
        return False
    if fault is JointCoupling and len(robot.joints) < 3:
        return False
    return not (fault.rotary and robot.prismatic.all())


def plans(seeds: str, count: int) -> Iterator[Plan]:
    """The first cases of a set of seeds; more cases begin with the same ones."""
    rng = np.random.default_rng(SEEDS[seeds])
    kinds = ("single",) if seeds in ONLY_ADDED else ("healthy",) if seeds in ONLY_HEALTHY else KINDS
    used: dict[str, int] = {}
    strengths = {"single": 0, "outside": 0}
    order: list[str] = []
    rigs: list[Profile] = []
    for number in range(count):
        order = order or list(rng.permutation(kinds))
        rigs = rigs or [PROFILES[i] for i in rng.permutation(len(PROFILES))]
        kind, profile = str(order.pop()), rigs.pop()
        pool = ADDED if seeds in ONLY_ADDED else OUTSIDE if kind == "outside" else LIBRARY
        fitting = [fault.name for fault in pool if applicable(profile, ROBOTS[profile.robot], fault)]
        chances = rng.random(len(fitting))
        # Effects that came least often come first; where several are wanted, the next ones are in reserve.
        ranked = [name for _, _, name in sorted((used.get(n, 0), c, n) for n, c in zip(fitting, chances, strict=True))]
        strength = 0.0 if kind == "healthy" else 1.0
        if kind in strengths:
            strength = (1.0, 0.3)[strengths[kind] % 2]
            strengths[kind] += 1
        for name in ranked[: {"healthy": 0, "pair": 2}.get(kind, 1)]:
            used[name] = used.get(name, 0) + 1
        candidates = () if kind == "healthy" else tuple(ranked)
        yield Plan((SEEDS[seeds], number), kind, profile.name, candidates, strength)
