"""The pictures of docs/placement.md: `python -m benchmarks.placement.figure`, from new placements and the results.

- placement.png: the nine scenes, each with the cube where it was put. packing.png: two packed totes.
- placement_growth.png: time against vertices and objects, from out/benchmarks/placement_growth.json.
"""

import argparse
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import NullFormatter

from benchmarks.placement import totes
from benchmarks.placement.growth import Row, grouped
from benchmarks.placement.run import FINAL
from benchmarks.placement.scenes import SCENES, cube, scene
from poise.files import write_whole
from poise.placement import Options, plan_placement
from poise.placement.packing import pack
from poise.viewing.assembly_picture import stage
from poise.viewing.canvas import PALETTE, STYLE, Panel, sheet

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
SIZE = (230, 210)
PLACED = "#d55e01"
SHADES = (PLACED, "#2062d4", "#00916b", "#e0a000", "#8a5cc9", "#5aa9d6")


def scene_panel(name: str) -> Panel:
    """A scene with the cube in it."""
    found = plan_placement(scene(name), cube(), Options(on="objects"), FINAL)
    assembly = found.analysis.assembly

    def draw(figure: FigureBase) -> None:
        stage(figure, assembly, (0, 0, 1, 0.9), colours={assembly.index[found.item.id]: PLACED})
        figure.text(0.04, 0.92, f"{name}, {found.score.least:.2f} N", fontsize=10.5, color=PALETTE["ink"])

    return Panel(name, f"{name}: the cube where it was put.", draw, SIZE)


def packing_panel(world: str) -> Panel:
    """A tote with twelve objects, without three of its walls."""
    found = pack(totes.tote(), totes.objects(world, totes.DEVELOPMENT))
    shown = tuple(
        item for item in found.analysis.assembly.objects if item.id not in ("floor", "front", "left", "right")
    )
    assembly = replace(found.analysis.assembly, objects=shown)
    colours = {assembly.index[one.item.id]: SHADES[k % len(SHADES)] for k, one in enumerate(found.placements)}

    def draw(figure: FigureBase) -> None:
        stage(figure, assembly, (0, 0, 1, 0.9), colours=colours)
        text = f"{world}: top {found.top:.3f} m, utilisation {found.utilisation:.0%}"
        figure.text(0.04, 0.92, text, fontsize=10.5, color=PALETTE["ink"])

    return Panel(world, f"{world}: twelve objects packed into a tote.", draw, (380, 300))


def growth(rows: dict[str, list[Row]]) -> Figure:
    """Time of contacts, map and plan against vertices, and against objects, on logarithmic scales."""
    figure = Figure(figsize=(8.4, 3.0), dpi=144, layout="constrained")
    for axes, of in zip(figure.subplots(1, 2), ("vertices", "objects"), strict=True):
        groups = grouped(rows[of], of)
        for what, colour in (("plan", PLACED), ("map", "#2062d4"), ("contacts", "#00916b")):
            means = [np.mean([row[what] for row in some if row[what] is not None]) for some in groups.values()]
            axes.loglog(list(groups), means, "o-", color=colour, label=what, markersize=4)
        axes.set_xlabel(of)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_ylabel("ms")
        axes.legend(frameon=False)
    return figure


def save(make: Callable[[], Figure], name: str) -> None:
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        make().savefig(buffer, format="png", metadata={"Software": None})
    write_whole(PICTURES / name, buffer.getvalue())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--growth", type=Path, default=Path("out/benchmarks/placement_growth.json"))
    arguments = parser.parse_args()
    panels = [scene_panel(name) for name in SCENES]
    save(lambda: sheet(panels, 5), "placement.png")
    save(lambda: sheet([packing_panel(world) for world in totes.WORLDS], 2), "packing.png")
    if arguments.growth.exists():
        rows = json.loads(arguments.growth.read_text())
        save(lambda: growth(rows), "placement_growth.png")


if __name__ == "__main__":
    main()
