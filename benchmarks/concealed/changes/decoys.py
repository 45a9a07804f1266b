"""What looks odd and is no physics left out: lost samples, outliers, loud sensors, bad clocks, odd motions."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.motions import DURATION, HOME, Curve, Motion, pick_and_place, still, through
from poise.types import Array, Mask

if TYPE_CHECKING:
    from benchmarks.concealed.scene import Scene


@dataclass
class Losses(Change):
    """A share of the messages of wrench and joint states, and some bursts of them, never arrive."""

    share: float = 0.0
    bursts: int = 0

    def lost(self, topic: str, seconds: Array, rng: np.random.Generator) -> Mask | None:
        if topic not in ("wrench", "joint_states"):
            return None
        gone = rng.random(len(seconds)) < self.share
        for start in rng.uniform(1.0, DURATION - 2.0, self.bursts):
            gone |= (seconds > start) & (seconds < start + rng.uniform(0.05, 0.4))
        return np.asarray(gone)


@dataclass
class Outliers(Change):
    """A share of the wrench samples is far off in some channels."""

    share: float = 0.0

    def read(self, wrench: Array, rng: np.random.Generator) -> Array:
        hit = (rng.random(len(wrench)) < self.share)[:, None] & (rng.random(wrench.shape) < 0.5)
        size = rng.uniform(3.0, 25.0, wrench.shape) * rng.choice([-1, 1], wrench.shape) * np.repeat([1.0, 0.05], 3)
        return np.asarray(wrench + hit * size)


def dropped_samples(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    return Losses(name="dropped_samples", share=rng.uniform(0.02, 0.15), bursts=int(rng.integers(0, 6)))


def outliers(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    return Outliers(name="outliers", share=rng.uniform(0.002, 0.01))


def loud_noise(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Three times the noise of the sensor's manual; model.yaml is silent about it."""
    return Change(name="loud_noise", noise=3.0)


def clock_jitter(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    return Change(name="clock_jitter", jitter=0.002)


def swaying_floor(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A ship: the floor sways, and odom says so (`motion_of` makes it)."""
    return Change(name="swaying_floor")


def unusual_motion(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Slow, short, one joint alone, or fast (`motion_of` makes it)."""
    return Change(name="unusual_motion")


def motion_of(decoy: str, usual: Motion, rng: np.random.Generator) -> Motion:
    """The motion of a decoy that lies in the motion; `usual` for others."""
    if decoy == "swaying_floor":
        return Motion(usual.name + ", swaying floor", usual.arm, _swaying(usual.base, rng))
    if decoy != "unusual_motion":
        return usual
    kind = str(rng.choice(["slow", "late", "one joint", "fast"]))
    if kind == "slow":
        arm = _slowed(pick_and_place(rng, speed=1.0), 0.12)
    elif kind == "late":
        move = pick_and_place(rng)
        arm = lambda t: move(np.maximum(t - 22.0, 0.0))  # noqa: E731
    elif kind == "one joint":
        poses = np.tile(HOME, (30, 1))
        poses[:, 4] += rng.uniform(-1.2, 1.2, 30)
        arm = through(poses, 1.2, 3.0, 0.12, rng.uniform(0.1, 0.4, 30))
    else:
        arm = pick_and_place(rng, speed=2.0)
    return Motion(f"{usual.name}, {kind}", arm, still(3) if kind != "fast" else usual.base)


def _swaying(base: Curve, rng: np.random.Generator) -> Curve:
    amplitude = rng.uniform(0.01, 0.04, 2)  # m
    rates, phases = 2 * np.pi * rng.uniform(0.12, 0.3, 2), rng.uniform(0, 2 * np.pi, 2)

    def curve(t: Array) -> tuple[Array, Array, Array]:
        angle = np.outer(t, rates) + phases
        sway = (np.sin(angle), rates * np.cos(angle), -(rates**2) * np.sin(angle))
        return tuple(
            there + np.pad(amplitude * more, ((0, 0), (0, 1))) for there, more in zip(base(t), sway, strict=True)
        )

    return curve


def _slowed(curve: Curve, rate: float) -> Curve:
    def slow(t: Array) -> tuple[Array, Array, Array]:
        position, velocity, acceleration = curve(t * rate)
        return position, velocity * rate, acceleration * rate**2

    return slow
