"""Inverse kinematics: configurations that bring the tool frame to a pose, and straight ways of the tool."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dposv

from poise.manipulation.arm import Arm
from poise.types import Array

_ITERATIONS = 60
_DAMPING = 0.03
"""Of the Gauss-Newton steps, far from the goal; it shrinks with the error (Levenberg)."""
_LONGEST_STEP = 0.5
"""rad in one iteration."""
_ACCURATE = 1e-6
"""m and rad."""
_LOOK = 5
"""Iterations in which the error has to halve: of what takes longer little arrives, and another start is cheaper."""
LARGEST_JOINT_STEP = 0.4
"""rad that a joint may turn between neighbouring poses of a straight way."""


def descend(arm: Arm, target: pin.SE3, start: Array, iterations: int = _ITERATIONS) -> Array | None:
    """The configuration (J,) that damped Gauss-Newton reaches from a start; None when it does not reach the pose.

    Minimises |log6(tool^-1 target)| within the joint limits; the Jacobian is the one of the logarithm.
    """
    model, data, tcp, lower, upper = arm.model, arm.data, arm.tcp, arm.lower, arm.upper
    q, goal = start.copy(), arm.base.actInv(target)
    if np.linalg.norm(goal.translation - arm.shoulder) > arm.reach:
        return None
    before = np.inf
    for number in range(iterations):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, tcp)
        offset = data.oMf[tcp].actInv(goal)
        error = pin.log6(offset).vector
        size = math.sqrt(error @ error)
        if size < _ACCURATE:
            return q
        if number % _LOOK == 0:
            if size > before / 2:
                return None  # it rests against joint limits, or in a local minimum
            before = size
        slope = pin.Jlog6(offset.inverse()) @ np.reshape(pin.getFrameJacobian(model, data, tcp, pin.LOCAL), (6, -1))
        square = slope @ slope.T
        square.flat[::7] += min(_DAMPING, size) * _DAMPING  # its diagonal
        # LAPACK by itself: numpy's checks take longer than six equations do, and this is asked thousands of times.
        step = slope.T @ dposv(square, error)[1]
        step *= min(1.0, _LONGEST_STEP / max(float(step.max()), -float(step.min()), 1e-12))
        q = np.minimum(np.maximum(q + step, lower), upper)
    return None


def solutions(
    arm: Arm, target: pin.SE3, starts: Sequence[Array], rng: np.random.Generator, tries: int = 8
) -> Iterator[Array]:
    """Configurations that reach a pose: from the given starts, then from random ones, `tries` in all."""
    for number in range(tries):
        start = starts[number] if number < len(starts) else rng.uniform(arm.lower, arm.upper)
        found = descend(arm, target, start)
        if found is not None:
            yield found


def follow(arm: Arm, start: Array, targets: Sequence[pin.SE3]) -> Array | None:
    """(N + 1, J) configurations along poses of the tool, each near the one before; None where the arm cannot go."""
    way = [start]
    for target in targets:
        found = descend(arm, target, way[-1], iterations=20)
        if found is None or np.abs(found - way[-1]).max() > LARGEST_JOINT_STEP:
            return None
        way.append(found)
    return np.array(way)
