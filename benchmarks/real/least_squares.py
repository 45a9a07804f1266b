"""Plain least squares with the true structure: what a fit reaches that knows what is missing from the nominal model.

The model is linear in its parameters (Gautier and Khalil 1990; Janot, Gautier and Brunot 2019 for EMPS): joint torques
are those of the links, plus viscous and Coulomb friction, rotor inertia, offset and couplings. Equations are filtered
without phase shift, decimated, and weighted once by the residual of each joint.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.signal

from benchmarks.real.rigs import Structure
from poise.recording import JointStream, Recording
from poise.types import Array, Mask

ORDER = 4
"""Of the Butterworth filter."""
EVERY = 5
"""Equations are built for one sample in five before they are decimated, at rates that are far above the cutoff."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Filtered signals.

    Args:
        position, velocity, acceleration, effort: (N, J) SI.
        dt: s between samples.
    """

    position: Array
    velocity: Array
    acceleration: Array
    effort: Array
    dt: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A least-squares model.

    Args:
        values: parameter by name, as in "viscous_1"; joints count from 1.
        nrmse: (J,) rms of the residual over rms of the effort, over all samples of the recording that it was fitted to.
        moving: (J,) the same over the samples beyond the dead band.
        nominal: (J,) the same for the URDF alone.
    """

    values: dict[str, float]
    nrmse: Array
    moving: Array
    nominal: Array


def motion_of(joints: JointStream, structure: Structure) -> Motion:
    """Filter positions and differentiate them; velocities as recorded where no cutoff is given."""
    dt = float(np.median(np.diff(joints.seconds)))
    if structure.cutoff:
        numerator, denominator = scipy.signal.butter(ORDER, 2 * dt * structure.cutoff)
        position = scipy.signal.filtfilt(numerator, denominator, joints.position, axis=0)
        velocity = np.gradient(position, dt, axis=0)
    else:
        position, velocity = joints.position, joints.velocity
    acceleration = np.gradient(velocity, dt, axis=0)
    inner = slice(structure.edge, -structure.edge)
    return Motion(position[inner], velocity[inner], acceleration[inner], joints.effort[inner], dt)


def equations(model: pin.Model, motion: Motion, structure: Structure) -> tuple[Array, Array, Array, list[str]]:
    """The linear equations of a motion.

    Returns:
        (N, J, P) regressor, (N, J) right side, (N, J) torque of the URDF, and the P names.
    """
    data = model.createData()
    states = list(zip(motion.position, motion.velocity, motion.acceleration, strict=True))
    rigid = np.array([pin.rnea(model, data, *state).copy() for state in states])
    joints = rigid.shape[1]
    columns: dict[str, Array] = {}

    def add(name: str, joint: int, values: Array) -> None:
        columns.setdefault(name, np.zeros_like(rigid))[:, joint] = values

    for joint in range(joints):
        number = joint + 1
        add(f"viscous_{number}", joint, motion.velocity[:, joint])
        add(f"coulomb_{number}", joint, np.sign(motion.velocity[:, joint]))
        add(f"offset_{number}", joint, np.ones(len(rigid)))
        if structure.rotor:
            add(f"rotor_{number}", joint, motion.acceleration[:, joint])
        if structure.gain:
            add(f"gain_{number}", joint, rigid[:, joint])
    for first, second in structure.couplings:
        both = np.sign(motion.velocity[:, first] + motion.velocity[:, second])
        for one, other in ((first, second), (second, first)):
            pair = f"{first + 1}_{second + 1}"
            add(f"coupled_rotor_{pair}", one, motion.acceleration[:, other])
            add(f"coupled_viscous_{pair}", one, motion.velocity[:, other])
            add(f"coupled_coulomb_{pair}", one, both)
    regressor = np.stack(list(columns.values()), axis=2)
    names = list(columns)
    if structure.links:
        links = np.array(
            [pin.computeJointTorqueRegressor(model, data, *state).reshape(joints, -1).copy() for state in states]
        )
        regressor = np.concatenate([regressor, links], axis=2)
        names += [f"link_{number // 10 + 1}_{number % 10}" for number in range(links.shape[2])]
    known = 0.0 if structure.links or structure.gain else rigid
    return regressor, motion.effort - known, rigid, names


def fit(recording: Recording, structure: Structure, validation: Recording | None = None) -> Fit:
    """Fit the structure to a recording; errors are those of the validation run where there is one.

    Args:
        recording: with joint states, efforts and the URDF.
        structure: what is fitted.
        validation: a second run of the same robot.
    """
    model = pin.buildModelFromXML(recording.robot_description())
    regressor, right, rigid, names, moving = _prepared(model, recording, structure)
    values = _solve(regressor, right, moving)
    tested = right
    if validation is not None:
        regressor, tested, rigid, _, moving = _prepared(model, validation, structure)
    residual = tested - regressor @ values
    effort = tested if structure.links or structure.gain else tested + rigid
    everything = np.ones_like(moving)
    return Fit(
        values=dict(zip(names, values.tolist(), strict=True)),
        nrmse=_nrmse(residual, effort, everything),
        moving=_nrmse(residual, effort, moving),
        nominal=_nrmse(effort - rigid, effort, everything),
    )


def _prepared(
    model: pin.Model, recording: Recording, structure: Structure
) -> tuple[Array, Array, Array, list[str], Mask]:
    """Decimated equations, and which of them are of a joint that moves."""
    joints = recording.joint_states(names=[name for name in model.names if name != "universe"])
    motion = motion_of(joints, structure)
    thin = EVERY if structure.decimation % EVERY == 0 else 1
    picked = slice(None, None, thin)
    signals = (motion.position, motion.velocity, motion.acceleration, motion.effort)
    thinned = Motion(*(signal[picked] for signal in signals), dt=thin * motion.dt)
    regressor, right, rigid, names = equations(model, thinned, structure)
    factor = structure.decimation // thin
    velocity = thinned.velocity
    if factor > 1:
        regressor, right, rigid, velocity = (
            _decimated(signal, factor) for signal in (regressor, right, rigid, velocity)
        )
    return regressor, right, rigid, names, np.asarray(np.abs(velocity) > structure.dead_band)


def _decimated(signal: Array, factor: int) -> Array:
    return np.asarray(scipy.signal.decimate(signal, factor, axis=0, ftype="iir", zero_phase=True))


def _solve(regressor: Array, right: Array, moving: Mask) -> Array:
    """(P,) the least-norm solution over the moving samples, weighted once by each joint's residual."""
    weights = np.ones(right.shape[1])
    values = np.zeros(regressor.shape[2])
    for _ in range(2):
        rows = (regressor * weights[:, None])[moving]
        values = np.linalg.lstsq(rows, (right * weights)[moving], rcond=1e-9)[0]
        residual = np.where(moving, right - regressor @ values, np.nan)
        weights = 1 / np.nanstd(residual, axis=0)
    return values


def _nrmse(residual: Array, effort: Array, chosen: Mask) -> Array:
    """(J,) rms over rms."""
    squares = [np.where(chosen, signal**2, np.nan) for signal in (residual, effort)]
    return np.asarray(np.sqrt(np.nanmean(squares[0], axis=0) / np.nanmean(squares[1], axis=0)))
