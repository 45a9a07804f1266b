"""One simulated weighing, and each kind of trouble in it, in closed form."""

import numpy as np
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode
from poise.inertia import InertialParameters
from poise.inertia.model import motion_signals, signal_columns
from poise.inertia.verdict import FitSamples

LOAD = InertialParameters(1.2, np.array([0.02, -0.03, 0.08]), np.diag([6e-3, 5e-3, 3e-3]))
BIAS = np.array([5.0, -3.0, 8.0, 0.2, -0.1, 0.3])
GRAVITY = np.array([0.0, 0.0, -9.80665])
SECONDS = np.arange(0.0, 12.0, 0.04)


def attitudes(seconds):
    """Slow and fast turning about all axes."""
    angles = np.stack(
        [1.2 * np.sin(0.9 * seconds), 0.9 * np.sin(1.7 * seconds + 1), 0.8 * np.sin(2.6 * seconds + 2)], axis=1
    )
    return Rotation.from_euler("xyz", angles)


def motion():
    """FitSamples without a wrench, from numerical derivatives of the attitude."""
    step = 1e-4

    def rate(seconds):
        return (attitudes(seconds - step).inv() * attitudes(seconds + step)).as_rotvec() / (2 * step)

    rotation = attitudes(SECONDS).as_matrix()
    omega = rate(SECONDS)
    alpha = (rate(SECONDS + step) - rate(SECONDS - step)) / (2 * step)
    acceleration = np.stack([1.5 * np.sin(3.1 * SECONDS + k) for k in range(3)], axis=1)
    down = np.einsum("nji,j->ni", rotation, GRAVITY)
    stamps = np.round(SECONDS * 1e9).astype(np.int64)
    signals = motion_signals(down - acceleration, omega, alpha)
    return FitSamples(stamps, np.ones(len(stamps)), rotation, signals, np.zeros((len(stamps), 6)), GRAVITY)


MOTION = motion()
CLEAN = signal_columns(MOTION.signals)[:, :, :10] @ LOAD.phi
NOISE = np.random.default_rng(3).normal(size=CLEAN.shape) * np.repeat([0.03, 0.001], 3)
READ = CLEAN + BIAS + NOISE


def both(turn):
    return np.kron(np.eye(2), turn)


def fixed(matrix):
    return CLEAN @ matrix.T + BIAS + NOISE


def base_axes():
    turned = np.einsum("nij,nkj->nki", MOTION.rotation_world_sensor, READ.reshape(-1, 2, 3))
    return turned.reshape(-1, 6)


def weight(phi):
    signals = np.zeros_like(MOTION.signals)
    signals[:, :3] = MOTION.gravity_in_sensor
    return signal_columns(signals)[:, :, :10] @ phi


def clipped():
    values = READ.copy()
    values[:, 2] = np.minimum(values[:, 2], np.percentile(values[:, 2], 75))
    return values


def late(seconds):
    return np.stack([np.interp(SECONDS - seconds, SECONDS, column) for column in CLEAN.T], axis=1) + BIAS + NOISE


def filtered(time):
    values, share = CLEAN.copy(), 1 - np.exp(-0.04 / time)
    for row in range(1, len(values)):
        values[row] = values[row - 1] + share * (CLEAN[row] - values[row - 1])
    return values + BIAS + NOISE


def base_drives():
    course = 0.8 * np.sin(2.2 * SECONDS)
    signals = np.zeros_like(MOTION.signals)
    signals[:, :3] = -course[:, None] * MOTION.rotation_world_sensor[:, 0, :]
    return READ + signal_columns(signals)[:, :, :10] @ LOAD.phi


def joint_off():
    """Gravity leans by five degrees to a side that follows the pose, as with the zero of a shoulder joint."""
    side = 1.3 * np.sin(0.45 * SECONDS)
    leaning = 0.0873 * 9.81 * np.stack([np.cos(side), np.sin(side), np.zeros(len(side))], axis=1)
    signals = np.zeros_like(MOTION.signals)
    signals[:, :3] = np.einsum("nji,nj->ni", MOTION.rotation_world_sensor, leaning)
    return READ + signal_columns(signals)[:, :, :10] @ LOAD.phi


def touched():
    on = (SECONDS > 3) & (SECONDS < 8)
    force = np.array([4.0, 3.0, 12.0]) * (1 + 0.4 * np.sin(5 * SECONDS))[:, None]
    pushed = np.einsum("nji,nj->ni", MOTION.rotation_world_sensor, force)
    return READ + on[:, None] * np.concatenate([pushed, np.cross([0.03, 0.05, 0.12], pushed)], axis=1)


def at_point(force, point):
    """(N, 6) a force (N, 3) in the world at a point of the tool."""
    turned = np.einsum("nji,nj->ni", MOTION.rotation_world_sensor, force)
    return np.concatenate([turned, np.cross(point, turned)], axis=1)


HOSE_END = np.array([0.06, -0.04, 0.15])


def hose(lift=-2.0):
    """A hose that pulls aside and downwards, or upwards, and more where it is stretched."""
    swing = np.stack([np.sin(0.8 * SECONDS), np.cos(0.6 * SECONDS), np.sin(0.7 * SECONDS + 1)], axis=1)
    return READ + at_point(np.array([3.0, 1.0, lift]) + 1.5 * swing, HOSE_END)


def grasped():
    return np.where((SECONDS < 5)[:, None], 0.0, CLEAN) + BIAS + NOISE


def drifting():
    return READ + np.outer(SECONDS / SECONDS[-1], [2.0, 0, -1.0, 0, 0, 0])


TURNED = both(Rotation.from_rotvec([0, 0, np.radians(35)]).as_matrix())
KINDS = {
    "turned": (fixed(TURNED), ErrorCode.SENSOR_ROTATED),
    "base axes": (base_axes(), ErrorCode.WRONG_FRAME),
    "mirrored": (fixed(both(np.diag([1.0, 1, -1]))), ErrorCode.LEFT_HANDED_AXES),
    "sign of all": (fixed(-np.eye(6)), ErrorCode.FORCE_SIGN),
    "sign of torque": (fixed(np.diag([1.0, 1, 1, -1, -1, -1])), ErrorCode.TORQUE_SIGN),
    "kgf": (READ * np.repeat([1 / 9.80665, 1], 3), ErrorCode.FORCE_UNIT),
    "N mm": (READ * np.repeat([1, 1000], 3), ErrorCode.TORQUE_UNIT),
    "clipped": (clipped(), ErrorCode.CLIPPED),
    "compensated": (READ - weight(LOAD.phi), ErrorCode.COMPENSATED),
    "partly compensated": (READ - weight(0.5 * LOAD.phi), ErrorCode.COMPENSATED),
    "force x and z exchanged": (READ[:, [2, 1, 0, 3, 4, 5]], ErrorCode.LEFT_HANDED_AXES),
    "dead channel": (READ * [1, 0, 1, 1, 1, 1], ErrorCode.SENSOR_FAULT),
    "gain of a channel": (READ * [1, 1, 1.15, 1, 1, 1], ErrorCode.POOR_FIT),
    "late": (late(0.15), ErrorCode.CLOCK_LATE),
    "filtered": (filtered(0.4), ErrorCode.FILTERED),
    "drift": (drifting(), ErrorCode.SENSOR_DRIFT),
    "grasped": (grasped(), ErrorCode.PAYLOAD_CHANGED),
    "touched": (touched(), ErrorCode.IN_CONTACT),
    "base drives": (base_drives(), ErrorCode.BASE_MOVED),
    "joint zero": (joint_off(), ErrorCode.POOR_FIT),
    "hose": (hose(), ErrorCode.IN_CONTACT),
    "hose that carries": (hose(15.0), ErrorCode.IN_CONTACT),
    "constant pull": (READ + at_point(np.tile([2.0, 1.0, 1.0], (len(SECONDS), 1)), HOSE_END), ErrorCode.IN_CONTACT),
}
