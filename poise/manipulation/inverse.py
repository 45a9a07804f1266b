"""Inverse kinematics: configurations that bring the tool frame to a pose, and straight ways of the tool."""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from poise.assembly.geometry import Array
from poise.manipulation.arm import Arm

ITERATIONS = 60
DAMPING = 0.03
"""Of the Gauss-Newton steps, far from the goal; it shrinks with the error (Levenberg)."""
LONGEST_STEP = 0.5
"""rad in one iteration."""
ACCURATE = 1e-6
"""m and rad."""
LOOK = 8
"""Iterations in which the error has to shrink by a third."""
IDENTITY = np.eye(6)
NEAR = 0.4
"""rad that a joint may turn between neighbouring poses of a straight way."""


def descend(arm: Arm, target: pin.SE3, start: Array, iterations: int = ITERATIONS) -> Array | None:
    """The configuration (J,) that damped Gauss-Newton reaches from a start; None when it does not reach the pose.

    Minimises |log6(tool^-1 target)| within the joint limits; the Jacobian is the one of the logarithm.
    """
    q, goal = start.copy(), arm.base.actInv(target)
    if np.linalg.norm(goal.translation - arm.shoulder) > arm.reach:
        return None
    before = np.inf
    for number in range(iterations):
        pin.computeJointJacobians(arm.model, arm.data, q)
        pin.updateFramePlacement(arm.model, arm.data, arm.tcp)
        jacobian = pin.getFrameJacobian(arm.model, arm.data, arm.tcp, pin.LOCAL)
        offset = arm.data.oMf[arm.tcp].actInv(goal)
        error = pin.log6(offset).vector
        size = float(np.linalg.norm(error))
        if size < ACCURATE:
            return q
        if number % LOOK == 0:
            if size > 0.7 * before:
                return None  # it rests against joint limits, or in a local minimum
            before = size
        slope = pin.Jlog6(offset.inverse()) @ jacobian
        damping = min(DAMPING, size) * DAMPING
        step = slope.T @ np.linalg.solve(slope @ slope.T + damping * IDENTITY, error)
        step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        q = np.clip(q + step, arm.lower, arm.upper)
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
        if found is None or np.abs(found - way[-1]).max() > NEAR:
            return None
        way.append(found)
    return np.array(way)
