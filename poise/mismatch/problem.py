"""One signal of one recording, held against the nominal model: what every hypothesis about it starts from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.calibration import Group, calibration, effort_calibration
from poise.mismatch.effects.base import LAYERS, Effect, Values
from poise.mismatch.evidence import Frame
from poise.mismatch.model import NominalModel
from poise.mismatch.noise import Noise, fit_noise
from poise.mismatch.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """An effect with values for its parameters: one piece of a hypothesis."""

    effect: Effect
    values: Values

    @property
    def order(self) -> tuple[int, int, str]:
        """In which the parts of a hypothesis act."""
        return LAYERS.index(self.effect.layer), self.effect.order, self.effect.name


@dataclass(frozen=True, eq=False)
class Problem:
    """A signal with its noise.

    Args:
        world: the recording; its predictions are the nominal model's.
        model: tolerances and stated noise.
        noise: of the signal.
        signal: wrench or effort.
    """

    world: World
    model: NominalModel
    noise: Noise
    signal: Literal["wrench", "effort"] = "wrench"

    @cached_property
    def measured(self) -> Array:
        """(N, C)."""
        return self.world.wrench if self.world.effort is None or self.signal == "wrench" else self.world.effort.measured

    @cached_property
    def seconds(self) -> Array:
        """(N,)."""
        return self.noise.seconds

    def predicted(self, world: World) -> Array:
        """(N, C) what a world says."""
        return world.prediction if world.effort is None or self.signal == "wrench" else world.effort.prediction

    def said(self, world: World, prediction: Array) -> World:
        """The world that says this of the signal."""
        return world.with_prediction(prediction) if self.signal == "wrench" else world.with_effort(prediction)

    def compose(self, parts: Sequence[Part]) -> tuple[list[World], World]:
        """The world that each part acts in, in the order given, and the world after all of them."""
        world = self.world
        before: dict[int, World] = {}
        for index, part in sorted(enumerate(parts), key=lambda item: item[1].order):
            before[index] = world
            world = self.said(world, self.predicted(world) + part.effect.simulate(world, part.values))
        return [before[index] for index in range(len(parts))], world

    def groups(self, world: World, parts: Sequence[Part] = ()) -> tuple[Group, ...]:
        """The calibration errors around a world, without those whose tolerance a part exceeds."""
        widened = {part.effect.widens for part in parts} - {""}
        make = calibration if self.signal == "wrench" else effort_calibration
        return tuple(group for group in make(world, self.model.tolerance) if group.name not in widened)

    def frame(self, parts: Sequence[Part] = (), world: World | None = None) -> Frame:
        """Whitened residual of these parts, with the calibration columns around what they say."""
        world = self.compose(parts)[1] if world is None else world
        groups = self.groups(world, parts)
        columns = np.concatenate([group.columns for group in groups], axis=2)
        keep = np.abs(columns).max(axis=(0, 1)) > 0.0
        sigma = np.concatenate([group.sigma for group in groups])[keep]
        white = self.whiten(columns[:, :, keep])
        target = self.whiten(self.measured - self.predicted(world))
        return Frame(white, sigma**-2.0, np.zeros(len(sigma)), target)

    def whiten(self, values: Array) -> Array:
        """(N, C) -> (R,); (N, C, k) -> (R, k), R = N C."""
        white = self.noise.whiten(values)
        return white.reshape(-1) if values.ndim == 2 else white.reshape(-1, values.shape[2])

    def with_noise(self, noise: Noise) -> "Problem":
        """The same under other noise."""
        return replace(self, noise=noise)

    def fitted_noise(self, residual: Array) -> Noise:
        """The most likely noise for a residual (N, C)."""
        return signal_noise(self.world, self.model, self.signal, residual)


def wrench_problem(world: World, model: NominalModel) -> Problem:
    """The wrench against the nominal model; its noise as after a first fit of the calibration."""
    return _begun(world, model, "wrench")


def effort_problem(world: World, model: NominalModel) -> Problem:
    """Joint efforts against the rigid arm."""
    return _begun(world, model, "effort")


def _begun(world: World, model: NominalModel, signal: Literal["wrench", "effort"]) -> Problem:
    rough = Problem(world, model, signal_noise(world, model, signal, None), signal)
    frame = rough.frame()
    fitted = frame.columns @ frame.coefficients()
    # Without colour whitening is division by sigma: the residual of the calibrated model, in the signal's units.
    residual = (frame.target - fitted).reshape(rough.measured.shape) * rough.noise.sigma
    return rough.with_noise(rough.fitted_noise(residual))


def signal_noise(
    world: World, model: NominalModel, signal: Literal["wrench", "effort"], residual: Array | None
) -> Noise:
    """Noise of a signal: white of the measured level when `residual` is None, else of the most likely kind."""
    if signal == "wrench" or world.effort is None:
        seconds, speed, measured = world.seconds, world.speed, world.wrench - world.prediction
        groups: tuple[slice, ...] = (slice(0, 3), slice(3, 6))
        given: tuple[float | None, ...] = (model.noise_force, model.noise_torque)
    else:
        track = world.effort
        seconds, speed = track.seconds, np.linalg.norm(track.velocity, axis=1)
        measured = track.measured - track.prediction
        groups = tuple(slice(j, j + 1) for j in range(len(track.names)))
        given = (None,) * len(groups)
    return fit_noise(seconds, speed, measured if residual is None else residual, groups, given, white=residual is None)
