"""The efforts of each link of a moving arm, for errors of the links' inertial parameters."""

import numpy as np
import pinocchio as pin

from poise.mismatch.recorded import LINK_PARAMETERS, LinkTrack
from poise.robot import RobotModel
from poise.types import Array, Mask


def link_track(
    robot: RobotModel, positions: Array, velocities: Array, accelerations: Array, gravity: float, known: Mask
) -> LinkTrack:
    """The links' efforts, by pinocchio's regressor of the joint torques (Atkeson, An, Hollerbach 1986).

    Args:
        robot: its links, with what the URDF fixes to them.
        positions, velocities, accelerations: (M, nq) or (M, nv) of the pinocchio model.
        gravity: m/s2, downwards.
        known: (J,) joints whose efforts are wanted.
    """
    model = robot.pinocchio.copy()
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    data = model.createData()
    moving = len(robot.coupling)
    first = model.njoints - moving
    joints = np.argmax(np.abs(robot.coupling), axis=1)
    links = [i for i in range(moving) if joints[i] >= robot.base_joints]
    count = len(LINK_PARAMETERS)
    phi = np.array([model.inertias[first + i].toDynamicParameters() for i in links]).reshape(-1, count)
    out = np.empty((len(positions), int(known.sum()), len(links), count))
    chosen = robot.coupling[:, known].T
    for row, q, v, a in zip(out, positions, velocities, accelerations, strict=True):
        # pinocchio gives a row for a single joint
        matrix = np.reshape(pin.computeJointTorqueRegressor(model, data, q, v, a), (model.nv, -1))
        wide = (chosen @ matrix[-moving:]).reshape(len(row), -1, count)[:, first - 1 :]
        row[:] = wide[:, links]
    efforts = np.einsum("mjlp,lp->mjl", out, phi)
    numbers = tuple(int(joints[i]) - robot.base_joints + 1 for i in links)
    slides = tuple(np.isin(robot.joint_names, robot.prismatic)[known].tolist())
    return LinkTrack(numbers, efforts, out * _sizes(phi), slides)


def _sizes(phi: Array) -> Array:
    """(L, 10) typical size of each parameter: of a light link, those of a tenth of the mean link."""
    mass = phi[:, 0]
    if not mass.any():
        return np.ones_like(phi)
    mass = np.maximum(mass, 0.1 * mass.mean())
    spread = np.trace(np.stack([pin.Inertia.FromDynamicParameters(p).inertia for p in phi]), axis1=1, axis2=2)
    reach2 = (0.5 * spread + np.sum(phi[:, 1:4] ** 2, axis=1) / mass) / mass
    reach = np.sqrt(np.maximum(reach2, 0.1 * reach2.mean() + 1e-6))
    return np.stack([mass, *[mass * reach] * 3, *[mass * reach**2] * 6], axis=1)
