"""The picture of docs/concealed.md: the wrenches of six effects on one motion, with the noise for comparison."""

import sys
from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.concealed.case import usual_motion
from benchmarks.concealed.changes import LIBRARY
from benchmarks.concealed.engine import Engine
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.recorder import FORCE
from benchmarks.concealed.scene import Scene

matplotlib.use("Agg")
from matplotlib import pyplot as plt

SHOWN = ("mass_step", "contact", "slosh", "loose_part", "grasp_compliance", "external_vibration")
STRENGTHS = (1.0, 0.3)


def draw(path: Path, seed: int = 11) -> None:
    """Force beyond the nominal one, along the axis where there is most of it, for strengths 1.0 and 0.3."""
    rng = np.random.default_rng(seed)
    scene = Scene(Payload.random(rng), usual_motion((), rng))
    figure, axes = plt.subplots(len(SHOWN), 1, figsize=(8, 9), sharex=True, layout="constrained")
    for name, axis in zip(SHOWN, axes, strict=True):
        for strength, colour in zip(STRENGTHS, ("#1f77b4", "#d95f02"), strict=True):
            change = LIBRARY[name](scene, strength, np.random.default_rng(seed))
            engine = Engine(scene.payload, scene.motion, [change])
            log = engine.run()
            nominal = Engine(scene.payload, scene.motion, step=engine.step).run()
            every = slice(None, None, round(0.01 / engine.step))
            added = (log.wrench - nominal.wrench)[every, :3]
            shown = added[:, added.std(axis=0).argmax()]
            axis.plot(log.seconds[every], shown, color=colour, linewidth=0.8, label=f"strength {strength:g}")
        axis.axhspan(-2 * FORCE, 2 * FORCE, color="0.85", zorder=0, label="two sigma of the white noise")
        axis.set_ylabel("N")
        axis.set_title(name, loc="left", fontsize=9)
    axes[1].legend(fontsize=7, loc="lower right")
    axes[-1].set_xlabel("s")
    unfinished = path.with_name(f".{path.name}.partial")
    figure.savefig(unfinished, dpi=110, format="png")
    plt.close(figure)
    unfinished.replace(path)


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures/concealed.png"))
