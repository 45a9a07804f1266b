"""The picture of an identification motion: joints, speeds against their limit, turning, and what will be known."""

import numpy as np
from matplotlib.figure import FigureBase

from poise.excitation import ExcitationPlan, Guard, HandMotion, hand_motion
from poise.inertia.model import PARAMETER_NAMES
from poise.robot import RobotModel
from poise.types import Array
from poise.viewing.canvas import PALETTE, Panel, add_axes

_SAMPLES = 600


def excitation_panels(model: RobotModel, plan: ExcitationPlan, guard: Guard, limit: float) -> list[Panel]:
    """Four panels of a plan; `limit` is the speed limit, m/s."""
    seconds = np.linspace(0.0, plan.motion.duration, _SAMPLES)
    motion = plan.motion.at(seconds)
    hand = hand_motion(model, *motion)
    moved = motion.position - motion.position[0]
    return [_joints(seconds, moved), _speeds(seconds, hand, guard, limit), _turning(seconds, hand), _known(plan)]


def point_speeds(hand: HandMotion, guard: Guard) -> tuple[Array, Array]:
    """(N,) m/s of the tool centre point, and at most of any guarded point."""
    turning = np.linalg.norm(hand.omega, axis=1)
    each = [np.linalg.norm(hand.velocity + np.cross(hand.omega, point), axis=1) for point in guard.points]
    return np.asarray(each[0]), np.asarray(np.max(each, axis=0) + guard.radius * turning)


def _joints(seconds: Array, moved: Array) -> Panel:
    reach = np.abs(moved).max()

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Joints, rad from the start")
        shades = np.linspace(0.25, 1.0, moved.shape[1])
        for column, shade in enumerate(shades):
            axes.plot(seconds, moved[:, column], color=PALETTE["accent"], alpha=float(shade), linewidth=1.1)

    return Panel("joints", f"Joint positions over time, up to {reach:.2f} rad from the start.", draw)


def _speeds(seconds: Array, hand: HandMotion, guard: Guard, limit: float) -> Panel:
    tool, farthest = point_speeds(hand, guard)

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Speed, m/s: tool centre, farthest point, limit")
        axes.plot(seconds, tool, color=PALETTE["measured"], linewidth=1.4)
        axes.plot(seconds, farthest, color=PALETTE["accent"], linewidth=1.4)
        axes.axhline(limit, color=PALETTE["rejected"], linewidth=1.0)
        axes.set_ylim(0.0, 1.1 * limit)

    alt = f"Speed of the tool centre point (to {tool.max():.3f} m/s) and of the object's farthest point (to"
    return Panel("speed", f"{alt} {farthest.max():.3f} m/s), under the limit of {limit:g} m/s.", draw)


def _turning(seconds: Array, hand: HandMotion) -> Panel:
    largest = np.abs(hand.alpha).max()

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Angular acceleration x y z, rad/s²")
        for axis, name in enumerate("xyz"):
            axes.plot(seconds, hand.alpha[:, axis], color=PALETTE[f"axis-{name}"], linewidth=1.1)

    return Panel("turning", f"Angular acceleration of the sensor about x, y and z, up to {largest:.1f} rad/s2.", draw)


def _known(plan: ExcitationPlan) -> Panel:
    share = 100 * np.sqrt(np.diag(plan.covariance) / np.diag(plan.belief.covariance))

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "What will be unknown of each parameter, %", below="")
        axes.bar(range(10), share, width=0.62, color=PALETTE["accent"])
        axes.set_xticks(range(10), PARAMETER_NAMES)
        axes.tick_params(axis="x", labelsize=9)

    alt = "Expected standard deviation after the motion, in per cent of what was thought before: "
    said = ", ".join(f"{name} {value:.2g}" for name, value in zip(PARAMETER_NAMES, share, strict=True))
    return Panel("known", alt + said, draw)
