"""The figures of an assembly: map of robustness, contact interface graph, collapse mechanism, acceleration limits."""

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import FigureBase
from matplotlib.patches import Polygon
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from poise.assembly import Analysis, Push
from poise.assembly.robustness import AccelerationLimits, Robustness, RobustnessMap
from poise.assembly.scene import Polyhedron
from poise.errors import ErrorCode, InputError
from poise.viewing.assembly_picture import Stage, SurfaceColours, extent, moved, stage, unconfirmed
from poise.viewing.canvas import PALETTE, Panel
from poise.viewing.wording import readable

_FIRST_MOVERS = ("#2062d4", "#d55e01", "#00916b", "#b3268c", "#8a6d00", "#5b6470")
_SIZE = (420, 330)
_SCALE = "RdYlBu"
"""Weak to strong; distinguishable for colour-blind readers."""
_SHARP = 0.9
"""Cosine of the angle between faces at an edge that is drawn."""
_ENDLESS = (0.62, 0.64, 0.67)


def map_panel(found: RobustnessMap) -> Panel:
    """The surface coloured by what each point bears, on a logarithmic scale (thesis Fig. 4.1, 4.12).

    Doubtful points are striped, and have the colour of their lower bound.
    """
    doubtful = unconfirmed(found)
    borne = np.where(doubtful, found.lower, found.upper)
    finite = borne[np.isfinite(borne) & (borne > 0)]
    # Few points may hold next to anything: they are not to squeeze the others into one colour.
    low, high = (float(finite.min()), float(np.quantile(finite, 0.97))) if len(finite) else (1.0, 1.0)
    scale = ScalarMappable(LogNorm(low, max(high, 1.02 * low)), _SCALE)
    colours = np.where(np.isfinite(borne)[:, None], scale.to_rgba(np.maximum(borne, low))[:, :3], _ENDLESS)

    def draw(figure: FigureBase) -> None:
        here = stage(figure, found.analysis.assembly, (0, 0, 0.84, 1), surface=SurfaceColours(found, colours))
        bar = figure.add_axes((0.86, 0.14, 0.03, 0.72))
        figure.colorbar(scale, cax=bar, extend="max" if finite.max(initial=high) > high else "neither")
        bar.set_title("N", fontsize=10.5, color=PALETTE["muted"], loc="left")
        bar.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        bar.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.yaxis.set_minor_formatter(NullFormatter())
        bar.tick_params(labelsize=10.5, labelcolor=PALETTE["ink"], length=2)
        weakest = int(borne.argmin())
        _mark(here, found.surface.points[weakest], f"{borne[weakest]:.3g} N{' (doubtful)' * bool(doubtful[weakest])}")
        notes = ["striped: doubtful, lower bound"] * bool(doubtful.any())
        notes += ["grey: holds any force"] * bool(np.isinf(borne).any())
        figure.text(0.83, 0.03, "; ".join(notes), fontsize=9.5, color=PALETTE["muted"], ha="right")

    alt = f"Robustness to pushes inward all over the surface: from {low:.3g} to {high:.3g} N."
    alt += f" {int(doubtful.sum())} of {len(doubtful)} points are doubtful." if doubtful.any() else ""
    return Panel("robustness-map", alt, draw, _SIZE)


def graph_panel(analysis: Analysis) -> Panel:
    """The contact interface graph over the bodies: an edge per place of contact, the fixed bodies as squares."""
    structure, objects = analysis.structure, analysis.assembly.objects

    def draw(figure: FigureBase) -> None:
        here = stage(figure, analysis.assembly, (0, 0, 1, 1), pale=0.55)
        for interface in structure.interfaces:
            flat = here.at(interface.points)
            here.axes.add_patch(Polygon(flat, closed=True, facecolor=PALETTE["axis-x"], alpha=0.35, linewidth=0))
            middle = interface.points.mean(axis=0)
            for place in (interface.first, interface.second):
                if objects[place].fixed:
                    here.axes.plot(*here.at(middle), "s", color=PALETTE["ink"], markersize=5, zorder=3)
                else:
                    path = here.at(np.stack([objects[place].com_in_world, middle]))
                    here.axes.plot(*path.T, color=PALETTE["axis-x"], linewidth=1.4, zorder=2)
        for place in structure.movable:
            _node(here, objects[place].com_in_world, objects[place].id)

    edges = len(structure.edges)
    alt = f"Contact interface graph of {len(structure.movable)} movable bodies with {edges} pairs in contact."
    return Panel("contact-graph", alt, draw, _SIZE)


def mechanism_panel(analysis: Analysis, push: Push, result: Robustness) -> Panel:
    """How a push moves things when it reaches the robustness: bodies displaced along the collapse mechanism."""
    assembly = analysis.assembly
    size = extent(analysis)
    elsewhere = moved(assembly, result.moves, result.mechanism, 0.12 * size) if result.moves else assembly
    force = f"{result.robustness:.3g} N" if np.isfinite(result.robustness) else "any force"
    force = f"at least {result.lower:.3g} N (doubtful)" if result.doubtful else force

    def draw(figure: FigureBase) -> None:
        moving = {assembly.index[name]: "#e3b23c" for name in result.moves}
        point, direction = np.asarray(push.point, float), np.asarray(push.direction, float)
        tail = point - 0.22 * size * direction / np.linalg.norm(direction)
        here = stage(figure, assembly, (0, 0, 1, 1), moving, shown=elsewhere, beside=tail[None], pale=0.15)
        for name in result.moves:
            item = assembly.objects[assembly.index[name]]
            for edge in item.vertices[_sharp_edges(item.shape.polyhedron)]:
                here.axes.plot(*here.at(edge).T, color=PALETTE["ink"], linewidth=0.6, linestyle=(0, (3, 3)), alpha=0.6)
            there = elsewhere.objects[assembly.index[name]]
            _arrow(here, item.com_in_world, there.com_in_world, PALETTE["ink"], 1.2)
        _arrow(here, tail, point, PALETTE["rejected"], 2.2)
        x, y = here.at(tail)
        _text(here, x, y, f"{force}: {result.mode}" if result.moves else force, above=False)

    moves = ", ".join(readable(name) for name in result.moves) or "nothing"
    return Panel("mechanism", f"Pushed with {force}, {moves} moves first.", draw, _SIZE)


def limits_panel(found: AccelerationLimits) -> Panel:
    """Limits over the azimuth of level directions, coloured by what moves first (thesis Fig. 4.16 as a polar plot)."""
    level = np.flatnonzero(np.abs(found.directions[:, 2]) < 1e-9)
    if not len(level):
        raise InputError(ErrorCode.UNSUPPORTED, "a polar plot needs directions in the horizontal plane (z = 0)")
    azimuth = np.arctan2(found.directions[level, 1], found.directions[level, 0])
    order = np.argsort(azimuth)
    level, azimuth = level[order], azimuth[order]
    limits = found.limits[level]
    doubtful = found.doubtful[level]
    finite = limits[np.isfinite(limits)]
    reach = 1.1 * float(finite.max(initial=1e-9))

    def draw(figure: FigureBase) -> None:
        axes: Any = figure.add_axes((0.08, 0.08, 0.6, 0.8), projection="polar")
        shown = np.minimum(limits, reach)
        around = np.append(azimuth, azimuth[0] + 2 * np.pi), np.append(shown, shown[0])
        axes.fill(*around, color=PALETTE["accent"], alpha=0.10, linewidth=0)
        axes.plot(*around, color=PALETTE["measured"], linewidth=1.0)
        names = [found.first_to_move[row] for row in level]
        for number, movers in enumerate(sorted(set(names))):
            rows = [row for row, name in enumerate(names) if name == movers]
            colour = _FIRST_MOVERS[min(number, len(_FIRST_MOVERS) - 1)]
            axes.plot(azimuth[rows], shown[rows], "o", color=colour, markersize=4, label=_names(movers))
        if doubtful.any():
            axes.plot(azimuth[doubtful], shown[doubtful], "x", color=PALETTE["ink"], markersize=7, label="doubtful")
        axes.set_ylim(0, reach)
        axes.grid(color=PALETTE["grid"])
        axes.spines["polar"].set_color(PALETTE["grid"])
        axes.tick_params(labelsize=10, labelcolor=PALETTE["muted"])
        axes.set_title("m/s², azimuth from x", fontsize=10.5, color=PALETTE["muted"], pad=12)
        figure.legend(loc="center right", fontsize=10, frameon=False, title="moves first", title_fontsize=10)

    low = float(finite.min()) if len(finite) else np.inf
    alt = f"Acceleration limits around the horizontal: at least {low:.3g} m/s²."
    alt += f" {int(doubtful.sum())} of {len(doubtful)} are doubtful." if doubtful.any() else ""
    return Panel("acceleration-limits", alt, draw, _SIZE)


def _sharp_edges(polyhedron: Polyhedron) -> Any:
    """(E, 2) vertex numbers of the edges that are seen as such, not those that round a surface."""
    normals = polyhedron.normals[polyhedron.edge_facets]
    return polyhedron.edges[np.einsum("ec,ec->e", normals[:, 0], normals[:, 1]) < _SHARP]


def _names(movers: tuple[str, ...]) -> str:
    if not movers:
        return "nothing"
    return ", ".join(readable(name) for name in movers[:3]) + (f" + {len(movers) - 3}" if len(movers) > 3 else "")


def _node(here: Stage, point: Any, label: str) -> None:
    x, y = here.at(point)
    here.axes.plot(x, y, "o", color=PALETTE["accent"], markersize=7, markeredgecolor="white", zorder=4)
    _text(here, x, y, readable(label))


def _mark(here: Stage, point: Any, label: str) -> None:
    x, y = here.at(point)
    here.axes.plot(x, y, "o", color=PALETTE["ink"], markersize=4.5, markeredgecolor="white", zorder=4)
    _text(here, x, y, label)


def _text(here: Stage, x: float, y: float, label: str, above: bool = True) -> None:
    shade = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    # Beside the point, on the side where there is room.
    right = x < 0.6 * here.camera.width
    offset = (6 if right else -6, 7 if above else -15)
    place: Any = {"xytext": offset, "textcoords": "offset points", "ha": "left" if right else "right"}
    here.axes.annotate(label, (x, y), fontsize=10, color=PALETTE["ink"], bbox=shade, zorder=5, **place)


def _arrow(here: Stage, start: Any, end: Any, colour: str, width: float) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": width, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    (tip_x, tip_y), (tail_x, tail_y) = here.at(end), here.at(start)
    here.axes.annotate("", (tip_x, tip_y), (tail_x, tail_y), arrowprops=style, zorder=4)
