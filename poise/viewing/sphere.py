"""The sphere of directions in the sensor frame, drawn from two sides, with a path of unit vectors on it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from poise.types import Array
from poise.viewing.canvas import PALETTE, SPARSE

_EYE = np.array([0.75, 0.5, 0.45]) / np.linalg.norm([0.75, 0.5, 0.45])

SPHERE_VIEWS = (("seen from +x +y +z", _EYE), ("seen from -x -y -z", -_EYE))
"""Title and direction of the eye; from opposite sides, so that nothing hides behind the sphere."""

_MAX_POINTS = 1500


def draw_sphere(axes: Axes, eye: Array, path: Array) -> None:
    """Draw the unit sphere with its three coordinate circles, and a path of unit vectors: faint where behind."""
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    # Columns: right, up and toward the eye.
    screen = np.stack([right, np.cross(eye, right), eye], axis=1)
    _draw_grid(axes, screen)
    points = path @ screen
    if len(points) <= SPARSE:
        for shown, alpha in ((points[points[:, 2] > 0], 1.0), (points[points[:, 2] <= 0], 0.25)):
            style: Any = {"color": PALETTE["accent"], "markersize": 4, "markeredgewidth": 0, "alpha": alpha}
            axes.plot(shown[:, 0], shown[:, 1], "o", **style)
        return
    points = points[:: max(1, len(points) // _MAX_POINTS)]
    axes.plot(points[:, 0], points[:, 1], color=PALETTE["accent"], linewidth=0.8, alpha=0.25)
    axes.plot(*_front(points), color=PALETTE["accent"], linewidth=1.8)


def _draw_grid(axes: Axes, screen: Array) -> None:
    """Outline, the circles of the three coordinate planes, and where the axes come out toward the eye."""
    angle = np.linspace(0, 2 * np.pi, 91)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    axes.plot(circle[:, 0], circle[:, 1], color=PALETTE["measured"], linewidth=1.0)
    for shift in range(3):
        axes.plot(*_front(np.roll(circle, shift, axis=1) @ screen), color=PALETTE["measured"], linewidth=0.7)
    for axis, name in enumerate("xyz"):
        sign = 1 if screen[axis, 2] > 0 else -1
        tip, colour = sign * screen[axis, :2], PALETTE[f"axis-{name}"]
        axes.plot(tip[0], tip[1], "o", color=colour, markersize=4, markeredgewidth=0)
        label = f"{'+' if sign > 0 else '-'}{name}"
        axes.annotate(label, (tip[0], tip[1]), (5, 4), textcoords="offset points", color=colour, fontsize=10.5)


def _front(points: Array) -> Array:
    """(2, N) x and y of what faces the eye, NaN where it does not."""
    return np.asarray(np.where(points[:, 2:] > 0, points[:, :2], np.nan).T)
