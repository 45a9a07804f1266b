"""How strong an effect is: its share of the signal against what a healthy recording of the same rig shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.foreign.fault import Fault
from benchmarks.foreign.honest import Honest
from benchmarks.foreign.profiles import Profile
from benchmarks.foreign.recorder import encoded, sensed
from benchmarks.foreign.robots import Array
from benchmarks.foreign.sensors import LEVER, Quantisation
from benchmarks.foreign.world import Scene, Track, UnstableError, World, rigid

MULTIPLE = 4.0
"""Strength 1: in the channel where the effect shows most, the change is four times what a healthy recording shows."""
OVER_TOLERANCE = 5.0
"""Strength 1 is at least five tolerances of the effect's own parameter, so that 0.3 is one and a half."""
CLOSE = 0.08
"""Relative error of the share at which the search ends."""
LEAST = 0.6
"""Share of the target that an effect at its largest size must reach to be used at all."""


@dataclass(frozen=True, eq=False)
class Signals:
    """What a run would give without noise, less what the model says of the reported motion.

    Args:
        wrench: (n, 6). effort: (n, J). active: (n,) 1 where an event acts.
    """

    wrench: Array
    effort: Array
    active: Array


@dataclass(frozen=True, eq=False)
class Rig:
    """A case before any effect: what is declared, what is true, and how it is recorded."""

    profile: Profile
    declared: Scene
    true: Scene
    honest: Honest

    def run(self, faults: Sequence[Fault]) -> Track:
        """Simulate the true scene with effects."""
        return World(self.true, faults).run()

    def signals(self, track: Track, faults: Sequence[Fault]) -> Signals:
        """The residual of a run at every tenth step."""
        rows = np.arange(20, len(track.seconds) - 20, 10)
        wrench, effort = rigid(self.declared, encoded(track, self.honest, faults), track.base, rows)
        return Signals(
            wrench=sensed(track, self.honest, faults)[rows] - wrench,
            effort=track.effort[rows] - effort,
            active=track.active[rows],
        )

    def noise(self) -> Signals:
        """One standard deviation of each channel's noise."""
        return Signals(
            wrench=self.profile.force * np.repeat([1.0, LEVER], 3),
            effort=self.profile.effort_level * np.array(self.declared.robot.effort),
            active=np.zeros(0),
        )


@dataclass(frozen=True, eq=False)
class Sized:
    """An effect at the size that a strength asks for, the share that it has, and the run that shows it."""

    fault: Fault
    share: float
    track: Track


def by_wrench(profile: Profile, fault: Fault) -> bool:
    """The strength of an effect is measured in the wrench; otherwise in the joint efforts."""
    return profile.wrench and fault.needs != "effort"


def share(rig: Rig, fault: Fault, healthy: Signals, changed: Signals) -> float:
    """The change by an effect as a multiple of noise and honest errors, in the channel where it shows most.

    A constant part counts only where the effect is a constant (`steady`); otherwise a bias may take its place.
    """
    kind = "wrench" if by_wrench(rig.profile, fault) else "effort"
    noise, before, after = (getattr(s, kind) for s in (rig.noise(), healthy, changed))
    honest = 0.0 if isinstance(fault, Quantisation) else before.std(axis=0)
    change = after - before
    if changed.active.any():
        change = change[changed.active > 0]
    elif not fault.steady:
        change = change - change.mean(axis=0)
    return float(np.max(np.sqrt(np.mean(change**2, axis=0)) / np.hypot(noise, honest)))


def tuned(rig: Rig, fault: Fault, strength: float, usual: tuple[Track, Signals]) -> Sized | None:
    """The effect at the size that a strength asks for; None where it cannot show.

    Args:
        rig, fault: case and effect. strength: 0.3 or 1.
        usual: the healthy run and its residual.
    """
    track, healthy = usual
    target, limit = MULTIPLE * strength, fault.limit(rig.true)
    least = OVER_TOLERANCE * strength * fault.outside_tolerance
    size = float(np.clip(fault.usual * strength, least, limit))
    best: tuple[float, Sized] | None = None
    for _ in range(7):
        trial = fault.at(size)
        try:
            run = rig.run([trial]) if fault.simulated else track
        except UnstableError:
            return None
        found = share(rig, trial, healthy, rig.signals(run, [trial]))
        off = abs(np.log(max(found, 1e-6) / target))
        if best is None or off < best[0]:
            best = (off, Sized(trial, found, run))
        following = float(np.clip(size * np.clip(target / max(found, 1e-6), 0.2, 5.0), least, limit))
        if off < CLOSE or abs(following - size) < 1e-3 * size:
            break
        size = following
    if best is None or best[1].share < LEAST * target:
        return None
    return best[1]
