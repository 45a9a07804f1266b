"""The picture of a table: bars per method on a logarithmic scale, the bounds as lines across them."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.identification.bounds import BOUNDS
from benchmarks.identification.evaluation import Experiment, Summary

mpl.use("Agg")
from matplotlib import pyplot as plt

PANELS = {"mass": "mass error e_m, %", "com": "centre of mass error e_c, %", "inertia": "inertia error e_I, %"}
COLOURS = ("#9aa5b1", "#5b7a99", "#d9a441", "#7aa874", "#a77bb5", "#c0504d")
LINES = ("-", "--", ":")
CUT = 1000.0  # %, what is worse is all the same


def draw(path: Path, experiment: Experiment, summaries: dict[tuple[str, str], Summary]) -> None:
    """Write a PNG: one panel per error measure, one group of bars per scenario."""
    scenarios = [scenario.name for scenario in experiment.scenarios]
    methods = list(experiment.methods)
    width = 0.8 / len(methods)
    figure, axes = plt.subplots(
        len(PANELS), 1, figsize=(max(8.0, 2.0 + 1.5 * len(scenarios)), 8.0), layout="constrained"
    )
    for axis, (name, label) in zip(axes, PANELS.items(), strict=True):
        for index, who in enumerate(methods):
            heights = [getattr(summaries[scenario, who], name) for scenario in scenarios]
            places = np.arange(len(scenarios)) + (index - (len(methods) - 1) / 2) * width
            axis.bar(places, heights, width * 0.9, label=who, color=COLOURS[index % len(COLOURS)])
        for line, bound in zip(LINES, BOUNDS, strict=True):
            for group, scenario in enumerate(scenarios):
                height = getattr(summaries[scenario, bound], name)
                axis.hlines(height, group - 0.42, group + 0.42, "black", line, label=bound if not group else None)
        axis.set_yscale("log")
        axis.set_ylim(top=min(axis.get_ylim()[1], CUT))
        axis.set_ylabel(label)
        axis.set_xticks(range(len(scenarios)), [scenario.replace(", ", "\n") for scenario in scenarios], fontsize=8)
        axis.grid(axis="y", alpha=0.3)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{experiment.title} (cut at {CUT:.0f} %)", x=0.01, ha="left")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    unfinished = path.with_suffix(".partial")
    figure.savefig(unfinished, dpi=130, format="png")
    unfinished.replace(path)
    plt.close(figure)
