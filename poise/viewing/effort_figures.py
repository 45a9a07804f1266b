"""The figures of effects on joint efforts: friction curves and other fitted responses, with the data behind them."""

import numpy as np
from matplotlib.figure import FigureBase

from poise.mismatch.answer import SignalDiagnosis
from poise.mismatch.inference import residual_of
from poise.types import Array
from poise.viewing.canvas import PALETTE, Panel, add_axes

_FRICTION = ("coulomb_friction", "viscous_friction", "stribeck_friction", "load_dependent_friction")
"""Effects whose response is drawn over the velocity of the joint."""
_POINTS, _CURVE = 300, 80
"""Points and stretches of a curve that are drawn."""
_NOTABLE = 0.5
"""Size of a response, in units of the noise, from which a joint is drawn."""


def friction_panels(examination: SignalDiagnosis, key: str) -> list[Panel]:
    """For each joint with a named friction: the fitted curve over its velocity, and the data less all else."""
    effort = examination.problem.recorded.effort
    if examination.problem.signal != "effort" or effort is None:
        return []
    responses = _responses(examination)
    curve = sum((responses[name] for name in _FRICTION if name in responses), np.zeros(effort.measured.shape))
    data = residual_of(examination.problem, examination.best) + curve
    panels = []
    for j in _drawn(examination, curve):
        name = effort.names[j]
        title, across = f"{name}, friction, {effort.unit('N m', name)}", effort.unit("rad/s", name)
        panels.append(_panel(f"{key}-{j}", title, across, effort.velocity[:, j], data[:, j], curve[:, j]))
    return panels


def response_panels(examination: SignalDiagnosis, key: str) -> list[Panel]:
    """For each other named effect on efforts: what was measured beyond all else over its response, in each joint."""
    effort = examination.problem.recorded.effort
    if examination.problem.signal != "effort" or effort is None:
        return []
    left, panels = residual_of(examination.problem, examination.best), []
    for name, response in _responses(examination).items():
        for j in () if name in _FRICTION else _drawn(examination, response):
            title = f"{effort.names[j]}, {name.replace('_', ' ')}"
            data = (left + response)[:, j]
            across = f"response, {effort.unit('N m', effort.names[j])}"
            panels.append(_panel(f"{key}-{name}-{j}", title, across, response[:, j], data, response[:, j]))
    return panels


def _responses(examination: SignalDiagnosis) -> dict[str, Array]:
    """(M, J) response of each named effect."""
    inputs = examination.problem.compose(examination.best.parts)[0]
    named = {finding.effect.name for finding in examination.findings}
    return {
        part.effect.name: part.effect.simulate(recorded, part.values)
        for part, recorded in zip(examination.best.parts, inputs, strict=True)
        if part.effect.name in named
    }


def _drawn(examination: SignalDiagnosis, response: Array) -> list[int]:
    size = np.sqrt(np.mean((response / examination.problem.noise.total) ** 2, axis=0))
    return [int(j) for j in np.flatnonzero(size > _NOTABLE)]


def _panel(key: str, title: str, across: str, place: Array, data: Array, curve: Array) -> Panel:
    """Data as dots, and the curve through its means over stretches of the abscissa."""
    order = np.argsort(place, kind="stable")
    dots = order[:: max(len(order) // _POINTS, 1)]
    parts = np.array_split(order, min(_CURVE, len(order)))
    explained = 1.0 - float(np.mean((data - curve) ** 2)) / max(float(np.mean(data**2)), 1e-300)
    alt = f"{title}: data over {across}; the curve explains {100 * explained:.0f} % of their square."

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, title, below=across)
        axes.plot(place[dots], data[dots], "o", color=PALETTE["measured"], markersize=2.4, markeredgewidth=0)
        means = [(float(place[part].mean()), float(curve[part].mean())) for part in parts]
        axes.plot(*zip(*means, strict=True), color=PALETTE["accent"], linewidth=1.8)

    return Panel(key, alt, draw)
