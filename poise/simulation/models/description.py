"""What the model file of a simulator says, in the same terms for every simulator."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

import numpy as np

ModelKind = Literal["mjcf", "sdf", "urdf"]
DriveKind = Literal["position", "velocity", "effort"]


@dataclass(frozen=True)
class JointPhysics:
    """The passive physics of a joint; for a slide N, N s/m, kg, N/m and m.

    Args:
        friction: dry friction, N m.
        damping: viscous friction, N m s/rad.
        armature: inertia of the rotor, reflected to the joint, kg m2.
        stiffness: of a spring, N m/rad.
        rest: position at which the spring is loose, rad.
        ramp, lead: of soft dry friction, whose force is that times (v + lead a) / ramp, with at most 1; rad/s and s.
            Zero: it reverses at once.
    """

    friction: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    ramp: float = 0.0
    lead: float = 0.0

    @property
    def values(self) -> dict[str, float]:
        """What is not zero, by name."""
        return {each.name: getattr(self, each.name) for each in fields(self) if getattr(self, each.name)}


@dataclass(frozen=True)
class JointDrive:
    """An actuator of a joint: tau = gear (gain u - stiffness gear q - damping gear v), u its command.

    Args:
        name: of the actuator; "" when it has none.
        kind: what u is: a position, a velocity, or an effort.
        gain: of the command. stiffness, damping: of the feedback.
        gear: joint speed to actuator speed.
        delay: s by which commands are late.
        time_constant: s of a first-order filter of the commands.
        limit: (least, largest) effort of the actuator, N m or N.
    """

    name: str
    kind: DriveKind
    gain: float
    stiffness: float = 0.0
    damping: float = 0.0
    gear: float = 1.0
    delay: float = 0.0
    time_constant: float = 0.0
    limit: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True)
class SensorNoise:
    """A sensor of a wrench: the frame in which it reads, and one sigma of its white noise, N and N m."""

    frame: str
    force: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True, eq=False)
class SimulatorModel:
    """A simulator's model.

    Args:
        path: of the file.
        kind: of the file.
        urdf: kinematics and inertia as the text of a URDF; force-torque sensors are links of it, with what they carry
            beyond them.
        joints: passive physics by the names of joints.
        drives: by the names of joints.
        sensors: of wrenches.
        gravity: m/s2, downwards.
        left_out: what of the file is not part of the prediction, as clauses.
    """

    path: Path
    kind: ModelKind
    urdf: str
    joints: Mapping[str, JointPhysics] = field(default_factory=dict)
    drives: Mapping[str, JointDrive] = field(default_factory=dict)
    sensors: tuple[SensorNoise, ...] = ()
    gravity: float | None = None
    left_out: tuple[str, ...] = ()

    def sensor(self, frame: str | None) -> SensorNoise | None:
        """The sensor that reads in a frame; without a frame the only one; None where there is none."""
        if frame is None:
            return self.sensors[0] if len(self.sensors) == 1 else None
        return next((each for each in self.sensors if each.frame == frame), None)
