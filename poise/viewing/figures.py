"""The figures of an identification, drawn with matplotlib for reports and for the documentation."""

import numpy as np
from matplotlib.figure import FigureBase
from scipy.spatial.transform import Rotation

from poise.inertia.model import PARAMETER_NAMES
from poise.inertia.pipeline import Identification
from poise.types import Array
from poise.viewing.canvas import PALETTE, Panel, add_axes, mark_rejected, trace
from poise.viewing.sphere import SPHERE_VIEWS, draw_sphere
from poise.viewing.summary import (
    SCALES,
    UNITS,
    finite_residual,
    residual,
    shown_parameters,
    shown_sigmas,
)

CHANNELS = ("Force x", "Force y", "Force z", "Torque x", "Torque y", "Torque z")
CHANNEL_UNITS = ("N", "N", "N", "N m", "N m", "N m")
_PARAMETER_TITLES = (
    "Mass",
    "Centre of mass x",
    "Centre of mass y",
    "Centre of mass z",
    "Inertia xx",
    "Inertia xy",
    "Inertia xz",
    "Inertia yy",
    "Inertia yz",
    "Inertia zz",
)


def wrench_panels(identification: Identification) -> list[Panel]:
    """Measured and predicted wrench over time, one panel per channel."""
    measured, predicted = identification.wrench_measured, identification.wrench_predicted
    left_over = finite_residual(identification)
    panels = []
    for channel, (name, unit) in enumerate(zip(CHANNELS, CHANNEL_UNITS, strict=True)):
        rms = np.sqrt(np.mean(left_over[:, channel] ** 2)) if len(left_over) else np.nan
        low, high = _limits(measured[:, channel])
        alt = (
            f"{name} over time: measured from {low:.3g} to {high:.3g} {unit}; "
            f"the prediction differs by {rms:.2g} {unit} rms."
        )

        def draw(figure: FigureBase, channel: int = channel, title: str = f"{name}, {unit}") -> None:
            axes = add_axes(figure, title)
            trace(axes, identification, measured[:, channel], "measured", "Measured", 2.0)
            trace(axes, identification, predicted[:, channel], "accent", "Predicted", 1.1)
            mark_rejected(axes, identification)

        panels.append(Panel(f"wrench-{channel}", alt, draw))
    return panels


def residual_panels(identification: Identification) -> list[Panel]:
    """What the model leaves over, over time, with its histogram on the same scale; one panel per channel."""
    left_over, finite = residual(identification), finite_residual(identification)
    panels = []
    for channel, (name, unit) in enumerate(zip(CHANNELS, CHANNEL_UNITS, strict=True)):
        kept = finite[:, channel]
        group = slice(0, 3) if channel < 3 else slice(3, 6)
        reach = 1.1 * np.max(np.abs(finite[:, group]), initial=1e-12)
        low, high = _limits(kept)
        alt = f"Residual of {name.lower()} over time and its histogram: from {low:.2g} to {high:.2g} {unit}."

        def draw(
            figure: FigureBase,
            channel: int = channel,
            kept: Array = kept,
            reach: float = reach,
            title: str = f"{name}, {unit}",
        ) -> None:
            axes = add_axes(figure, title, right=0.25)
            axes.axhline(0, color=PALETTE["muted"], linewidth=0.8)
            trace(axes, identification, left_over[:, channel], "accent", "Residual", 0.9)
            axes.set_ylim(-reach, reach)
            mark_rejected(axes, identification)
            _histogram(figure, kept, reach)

        panels.append(Panel(f"residual-{channel}", alt, draw))
    return panels


def convergence_panels(identification: Identification) -> list[Panel]:
    """Each identified parameter over the samples used, with two standard deviations on both sides."""
    history = identification.history
    if len(history) < 2:
        return []
    count = np.array([estimate.n_samples for estimate in history], dtype=float)
    values = np.array([shown_parameters(estimate) for estimate in history]) * SCALES
    sigmas = np.array([shown_sigmas(estimate) for estimate in history]) * SCALES
    panels = []
    for index, (title, unit) in enumerate(zip(_PARAMETER_TITLES, UNITS, strict=True)):
        value, sigma = values[:, index], sigmas[:, index]
        if not np.isfinite(value[-1]):
            continue
        alt = (
            f"{title} over {count[-1]:.0f} samples: the last estimate is {value[-1]:.4g} {unit} "
            f"with a standard deviation of {sigma[-1]:.2g} {unit}."
        )

        def draw(
            figure: FigureBase, value: Array = value, sigma: Array = sigma, title: str = f"{title}, {unit}"
        ) -> None:
            axes = add_axes(figure, title, below="samples used")
            axes.axhline(value[-1], color=PALETTE["muted"], linewidth=0.8, linestyle=(0, (3, 3)))
            band = (value - 2 * sigma, value + 2 * sigma)
            axes.fill_between(count, *band, color=PALETTE["accent"], alpha=0.18, linewidth=0)
            axes.plot(count, value, color=PALETTE["accent"], linewidth=1.4, gid="series-Estimate")
            axes.set_ylim(*_settled_limits(value, sigma))

        panels.append(Panel(f"convergence-{PARAMETER_NAMES[index]}", alt, draw))
    return panels


def motion_panels(identification: Identification) -> list[Panel]:
    """Orientation, angular velocity and the accelerations of the sensor over time."""
    motion = identification.motion
    curves = (
        ("orientation", "Turn from the first pose, °", np.degrees(turn_from_first(motion.rotation_world_sensor))),
        ("gravity", "Direction of gravity", -motion.rotation_world_sensor[:, 2, :]),
        ("velocity", "Angular velocity, rad/s", motion.angular_velocity_in_sensor),
        ("angular", "Angular acceleration, rad/s²", motion.angular_acceleration_in_sensor),
        ("linear", "Linear acceleration, m/s²", motion.linear_acceleration_in_sensor),
    )
    panels = []
    for key, title, values in curves:
        greatest = np.max(np.linalg.norm(values, axis=1), initial=0.0)
        alt = f"{title}, in sensor axes x, y and z over time; greatest length {greatest:.3g}."

        def draw(figure: FigureBase, values: Array = values, title: str = title) -> None:
            axes = add_axes(figure, title)
            for axis, name in enumerate("xyz"):
                trace(axes, identification, values[:, axis], f"axis-{name}", name, 1.1, motion.stamps)
            if not np.any(values):
                axes.set_ylim(-1, 1)
            mark_rejected(axes, identification)

        panels.append(Panel(f"motion-{key}", alt, draw))
    return panels


def sphere_panel(identification: Identification) -> Panel:
    """Path of gravity's direction over the sphere of directions in the sensor frame, from two sides."""
    down = -identification.motion.rotation_world_sensor[:, 2, :]
    turned = np.degrees(np.arccos(np.clip(np.min(down @ down[0], initial=1.0), -1, 1))) if len(down) else 0.0

    def draw(figure: FigureBase) -> None:
        for place, (title, eye) in enumerate(SPHERE_VIEWS):
            axes = figure.add_axes((0.02 + 0.49 * place, 0.02, 0.47, 0.86))
            axes.set_aspect("equal")
            axes.set_axis_off()
            axes.set_xlim(-1.18, 1.18)
            axes.set_ylim(-1.18, 1.18)
            axes.set_title(title, fontsize=11.5, color=PALETTE["muted"], pad=0)
            draw_sphere(axes, eye, down)

    alt = f"Direction of gravity in the sensor frame, on a sphere seen from two sides: it moved by up to {turned:.0f}°."
    return Panel("sphere", alt, draw, (360, 200))


def turn_from_first(rotation_world_sensor: Array) -> Array:
    """(N, 3) rotation vectors, rad, in sensor axes, from the first pose to each; continuous up to a full turn.

    Args:
        rotation_world_sensor: (N, 3, 3).
    """
    if not len(rotation_world_sensor):
        return np.zeros((0, 3))
    quaternion = Rotation.from_matrix(rotation_world_sensor[0].T @ rotation_world_sensor).as_quat()
    quaternion *= np.sign(quaternion[0, 3]) or 1.0
    # q and -q are one rotation: stay on the side of the neighbour, so that half a turn is no jump.
    flips = np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0, -1.0, 1.0)
    quaternion[1:] *= np.cumprod(flips)[:, None]
    length = np.linalg.norm(quaternion[:, :3], axis=1)
    angle = 2 * np.arctan2(length, quaternion[:, 3])
    scale = np.divide(angle, length, out=np.full_like(angle, 2.0), where=length > 1e-12)
    return np.asarray(quaternion[:, :3] * scale[:, None])


def _histogram(figure: FigureBase, values: Array, reach: float) -> None:
    """Histogram lying on its side right of a residual, with the normal density of the same mean and spread."""
    axes = figure.add_axes((0.78, 0.15, 0.2, 0.70))
    axes.set_axis_off()
    axes.set_ylim(-reach, reach)
    spread = np.std(values) if len(values) else 0.0
    if spread == 0:
        return
    bins = int(np.clip(2 * np.sqrt(len(values)), 7, 31))
    density, edges = np.histogram(values, bins=bins, range=(-reach, reach), density=True)
    axes.barh((edges[:-1] + edges[1:]) / 2, density, height=0.85 * (edges[1] - edges[0]), color=PALETTE["measured"])
    grid = np.linspace(-reach, reach, 121)
    normal = np.exp(-(((grid - np.mean(values)) / spread) ** 2) / 2) / (spread * np.sqrt(2 * np.pi))
    axes.plot(normal, grid, color=PALETTE["ink"], linewidth=1.0)
    axes.set_xlim(0, 1.05 * max(normal.max(), density.max()))


def _settled_limits(value: Array, sigma: Array) -> tuple[float, float]:
    """Limits of y that show the settling, not the wild first guesses: what the later three quarters reach."""
    later = slice(len(value) // 4, None)
    reach = np.nan_to_num(2 * sigma[later])
    low, high = np.nanmin(value[later] - reach), np.nanmax(value[later] + reach)
    margin = 0.05 * (high - low) or max(abs(high), 1e-9) * 0.05
    return float(low - margin), float(high + margin)


def _limits(values: Array) -> tuple[float, float]:
    """Least and greatest finite value; NaN of none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
