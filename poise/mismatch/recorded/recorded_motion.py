"""One recording as effects see it: measured wrench, predicted wrench, and the motion behind them."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from poise.mismatch.recorded.link_track import LinkTrack
from poise.mismatch.recorded.load_wrench import load_wrench
from poise.mismatch.recorded.resampling import at_times, linear_at
from poise.simulation.models import JointPhysics
from poise.types import Array, Mask

T = TypeVar("T")

_WORLD = np.eye(3)
_OF_SLIDES = {"N m": "N", "N m s/rad": "N s/m", "kg m2": "kg", "rad": "m", "mrad": "mm", "rad/s": "m/s"}
"""Units of joints that slide, by those of joints that turn."""
_USUAL = 0.99
"""Quantile of efforts and speeds that are usual at work, and no spikes."""


@dataclass(frozen=True, eq=False)
class JointTrack:
    """The joints that move the sensor, at the wrench's stamps.

    Args:
        names: (J) from the base outwards.
        position, velocity, acceleration: (N, J) rad or m, and their rates.
        jacobian_in_sensor: (N, 6, J) velocity of the sensor's origin (rows 0 to 2) and angular velocity (3 to 5) per
            unit joint speed, sensor axes; rows 3 to 5 of a column are the axis of a revolute joint.
        motion_by_position: (N, 9, J) derivative of (linear acceleration without gravity, angular velocity, angular
            acceleration), sensor axes, by the position of each joint, its speed and acceleration held.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    acceleration: Array
    jacobian_in_sensor: Array
    motion_by_position: Array


@dataclass(frozen=True, eq=False)
class BaseTrack:
    """How the robot's base moves in the world, at the wrench's stamps: (N, 3) m, m/s, m/s2, and in base axes rad/s.

    rotation_world_base: (N, 3, 3).
    """

    rotation_world_base: Array
    position_in_world: Array
    velocity_in_world: Array
    acceleration_in_world: Array
    angular_velocity_in_base: Array
    angular_acceleration_in_base: Array


@dataclass(frozen=True, eq=False)
class CommandTrack:
    """What the joints were commanded, at stamps of their own (K).

    Args:
        seconds: (K,) on the clock of the recording, ascending.
        names: (J) the joints that have commands.
        position: (K, J) rad or m.
        velocity: (K, J); NaN where only positions were sent.
    """

    seconds: Array
    names: tuple[str, ...]
    position: Array
    velocity: Array

    def position_at(self, seconds: Array) -> Array:
        """(N, J) the commanded positions at some seconds (N,), interpolated linearly."""
        return linear_at(self.seconds, self.position, seconds)


AT_REST = 2e-3
"""rad or m within which a joint stands still."""


def moving(position: Array) -> Mask:
    """(J,) joints that do not stand still, from positions (N, J), rad or m."""
    return np.asarray(np.ptp(np.quantile(position, [0.01, 0.99], axis=0), axis=0) >= AT_REST)


@dataclass(frozen=True, eq=False)
class EffortTrack:
    """Joint efforts, at the stamps of the joint states (M); N m, or N of prismatic joints.

    Args:
        seconds: (M,) on the clock of the recording.
        names: (J) joints with a measured effort.
        position, velocity, acceleration: (M, J).
        measured: (M, J) what was recorded.
        rigid: (M, J) what the arm and its payload need without friction, by the recursive Newton-Euler algorithm.
        prediction: (M, J) what the model predicts so far; begins as `rigid`.
        by_position, by_acceleration: (M, J, J) d rigid / d position; the joint-space inertia.
        links: what each link adds; None when it was not computed.
        by_gravity: (M, J, 3) N m per m/s2, d rigid by gravity along the axes of the world; None where the mass of the
            arm is not known. The base's acceleration acts like gravity against it.
        motion_variance: (M, J) variance of `rigid` by the errors of the measured motion; None: the motion is exact.
        by_rest: (M, J) efforts of the part of the wrench that no effect explains; None: there is none.
        prismatic: names of the joints that slide: quantities are then in m and N instead of rad and N m.
        stated: (J) the friction, rotors and springs that the nominal model has, in `prediction` from the beginning; ():
            a rigid arm.
        passive: (M, J) the efforts of `stated` in `prediction`; None: none.
        errors_cancel: `measured` is without what another recording of the same motion has beyond `prediction`: errors
            of the model have no part in the residual.
        stuck: (M, J) readings of joints that stand still in dry friction, which carries any load up to its size: they
            say nothing of a smaller one. None: no reading is.
    """

    seconds: Array
    names: tuple[str, ...]
    position: Array
    velocity: Array
    acceleration: Array
    measured: Array
    rigid: Array
    prediction: Array
    by_position: Array
    by_acceleration: Array
    links: LinkTrack | None = None
    by_gravity: Array | None = None
    motion_variance: Array | None = None
    by_rest: Array | None = None
    prismatic: tuple[str, ...] = ()
    stated: tuple[JointPhysics, ...] = ()
    passive: Array | None = None
    errors_cancel: bool = False
    stuck: Mask | None = None

    @cached_property
    def period(self) -> float:
        """s, the median time between samples."""
        return float(np.median(np.diff(self.seconds)))

    @cached_property
    def moves(self) -> Mask:
        """(J,) joints that do not stand still."""
        return moving(self.position)

    @cached_property
    def sizes(self) -> Array:
        """(J,) usual size of the measured efforts."""
        return np.asarray(np.quantile(np.abs(self.measured), _USUAL, axis=0))

    @cached_property
    def speeds(self) -> Array:
        """(J,) rad/s or m/s, usual speed of each joint under way."""
        return np.asarray(np.quantile(np.abs(self.velocity), _USUAL, axis=0))

    @property
    def accelerating(self) -> Array:
        """(M, J) the part of `rigid` that accelerations need: the joint-space inertia times them."""
        return np.asarray(np.einsum("mij,mj->mi", self.by_acceleration, self.acceleration))

    def by_tilt(self, gravity: float, axes: Array = _WORLD) -> Array | None:
        """(M, J, 2) N m/rad, d rigid by the rotation of the base about two level axes; None: see `by_gravity`.

        Args:
            gravity: m/s2, downwards.
            axes: (3, 3) or (M, 3, 3) rotation from the axes x and y to the world.
        """
        turned = axes[..., :2] @ np.array([[0.0, gravity], [-gravity, 0.0]])
        return None if self.by_gravity is None else np.asarray(self.by_gravity @ turned)

    def select(self, rows: Mask) -> "EffortTrack":
        """The samples of a mask (M,)."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        held: dict[str, Any] = {
            name: value for name, value in arrays.items() if isinstance(value, np.ndarray | LinkTrack)
        }
        return replace(self, **{name: value[rows] for name, value in held.items()})

    def named(self, mask: Mask) -> tuple[str, ...]:
        """The joints of a mask (J,)."""
        return tuple(name for name, chosen in zip(self.names, mask.tolist(), strict=True) if chosen)

    def of_joints(self, keep: Mask) -> "EffortTrack":
        """The efforts of the joints of a mask (J,); derivatives count by these joints alone."""
        changes: dict[str, Any] = {"names": self.named(keep)}
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, np.ndarray) and value.ndim > 1:
                by_joint = each.name in ("by_position", "by_acceleration")
                changes[each.name] = value[:, keep][:, :, keep] if by_joint else value[:, keep]
        if self.stated:
            changes["stated"] = tuple(each for each, kept in zip(self.stated, keep.tolist(), strict=True) if kept)
        if self.links is not None:
            links = self.links
            changes["links"] = links.of_joints(keep)
        return replace(self, **changes)

    def unit(self, turning: str, *joints: str) -> str:
        """The unit of a quantity of these joints, all when none is named, from its unit for joints that turn."""
        slides = set(joints or self.names) <= set(self.prismatic)
        return _OF_SLIDES.get(turning, turning) if slides else turning


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A recording at the stamps of its N good wrench samples, or without a wrench of its joint efforts.

    What was lost or not finite is absent.

    Vectors are in sensor axes unless the name says `in_world`. Stamps need not be uniform.

    Args:
        start: int ns, the stamp that `seconds` count from.
        seconds: (N,) s, ascending.
        wrench: (N, 6) N and N m that the sensor read; NaN without a sensor, and in a motion that is only simulated.
        phi: (10,) the nominal payload (m, m c, I about the sensor's origin).
        prediction: (N, 6) what the model predicts so far; begins as the nominal wrench.
        gravity: (N, 3) m/s2, in sensor axes.
        linear_acceleration: (N, 3) m/s2 of the sensor's origin, without gravity.
        angular_velocity, angular_acceleration: (N, 3).
        rotation_world_sensor: (N, 3, 3).
        position_in_world, velocity_in_world: (N, 3) of the sensor's origin.
        joints: None when the motion came from tf.
        base: None when the base rests.
        effort: None when joint efforts were not recorded.
        commands: None when no commands were recorded.
        accelerometer: (N, 3) m/s2 acceleration of the sensor as an accelerometer on it measured, without gravity and
            offset; its clock may be offset. None without an accelerometer.
        motion_variance: (N, 6) variance of the nominal wrench by the errors of the measured motion; None: the motion is
            exact.
        place_noise: m, one sigma of the measured position of the base, or without joints of the sensor; 0: exact.
        begins: s at which further recordings begin, where there are several.
        lag: s by which effects delay the wrench that is predicted so far.
        _of_motion: see `once`.
    """

    start: int
    seconds: Array
    wrench: Array
    phi: Array
    prediction: Array
    gravity: Array
    linear_acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    rotation_world_sensor: Array
    position_in_world: Array
    velocity_in_world: Array
    joints: JointTrack | None = None
    base: BaseTrack | None = None
    effort: EffortTrack | None = None
    commands: CommandTrack | None = None
    accelerometer: Array | None = None
    motion_variance: Array | None = None
    place_noise: float = 0.0
    begins: tuple[float, ...] = ()
    lag: float = 0.0
    _of_motion: dict[object, Any] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def duration(self) -> float:
        """s from the first sample to the last."""
        return float(self.seconds[-1] - self.seconds[0])

    @cached_property
    def period(self) -> float:
        """s, the median time between samples."""
        return float(np.median(np.diff(self.seconds)))

    @property
    def specific(self) -> Array:
        """(N, 3) m/s2: gravity minus acceleration: the specific force on a load."""
        return self.once("specific", lambda: self.gravity - self.linear_acceleration)

    @property
    def nominal(self) -> Array:
        """(N, 6) the wrench of the nominal payload alone."""
        turning = self.angular_velocity, self.angular_acceleration
        return self.once("nominal", lambda: load_wrench(self.phi, self.specific, *turning))

    @cached_property
    def speed(self) -> Array:
        """(N,) rad/s: the norm of the joints' speeds (without joints, of the sensor's angular velocity)."""
        rates = self.angular_velocity if self.joints is None else self.joints.velocity
        return np.asarray(np.linalg.norm(rates, axis=1))

    def has(self, what: str) -> bool:
        """Whether it holds "wrench", "joints", "effort", "commands", a moving "base", or a "load" with a mass."""
        if what == "wrench":
            return bool(np.isfinite(self.wrench).any())
        held = {"joints": self.joints, "effort": self.effort, "commands": self.commands, "base": self.base}
        return held[what] is not None if what in held else bool(abs(self.phi[0]) > 1e-3)

    def recording_of(self, time: float) -> Mask:
        """(N,) the samples of the recording that contains a time, s."""
        edges = np.array([-np.inf, *self.begins, np.inf])
        place = int(np.clip(np.searchsorted(edges, time, side="right"), 1, len(edges) - 1))
        return np.asarray((self.seconds >= edges[place - 1]) & (self.seconds < edges[place]))

    def with_prediction(self, prediction: Array, later: float = 0.0) -> "RecordedMotion":
        """The recording with another predicted wrench (N, 6), `later` (s) than the present one."""
        return self._moving_alike(replace(self, prediction=prediction, lag=self.lag + later))

    def with_effort(self, prediction: Array) -> "RecordedMotion":
        """The recording with other predicted joint efforts (M, J)."""
        if self.effort is None:
            return self
        return self._moving_alike(replace(self, effort=replace(self.effort, prediction=prediction)))

    def once(self, key: object, make: Callable[[], T]) -> T:
        """What `make` returns, computed once for all predictions: it depends on motion, payload and readings alone."""
        if key not in self._of_motion:
            self._of_motion[key] = make()
        made: T = self._of_motion[key]
        return made

    def _moving_alike(self, other: "RecordedMotion") -> "RecordedMotion":
        object.__setattr__(other, "_of_motion", self._of_motion)
        return other

    def select(self, rows: Mask) -> "RecordedMotion":
        """The samples of a mask (N,); joint efforts, which have other stamps, are kept."""
        arrays = {
            field.name: getattr(self, field.name)[rows]
            for field in fields(self)
            if isinstance(getattr(self, field.name), np.ndarray) and field.name != "phi"
        }
        tracks = {
            name: None if track is None else replace(track, **_rows(track, rows))
            for name, track in (("joints", self.joints), ("base", self.base))
        }
        return replace(self, **arrays, **tracks)  # type: ignore[arg-type]

    def axes_of_base(self, seconds: Array) -> Array:
        """(M, 3, 3) rotation from the base to the world at some times (M,); that of the world if there is no base."""
        if self.base is None:
            return np.broadcast_to(_WORLD, (len(seconds), 3, 3))
        return at_times(self.seconds, self.base.rotation_world_base.reshape(-1, 9), seconds).reshape(-1, 3, 3)

    def to_world(self, vectors: Array) -> Array:
        """(N, 3) in sensor axes -> world axes."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotation_world_sensor, vectors))

    def to_sensor(self, vectors_in_world: Array) -> Array:
        """(N, 3) or (3,) in world axes -> (N, 3) sensor axes."""
        wide = np.broadcast_to(vectors_in_world, (len(self), 3))
        return np.asarray(np.einsum("nji,nj->ni", self.rotation_world_sensor, wide))


def _rows(track: JointTrack | BaseTrack, rows: Mask) -> dict[str, Any]:
    arrays = ((field.name, getattr(track, field.name)) for field in fields(track))
    return {name: value[rows] for name, value in arrays if isinstance(value, np.ndarray)}
