"""Where objects stay, planner against planner: `python -m benchmarks.placement.run --quick`.

- `scenes`: the nine scenes and the ten objects, and the command that writes them to docs/scenes/placement.
- `packing`: twelve objects into a tote, against packers on heightmaps (`totes`, `heightmaps`).
- `unseen`: placements in kitchens, racks, drawers, totes and pallets (`unseen_scenes`), with one place left, or none.
- `run`: Table 5.1 of the thesis with every pose checked in MuJoCo. `growth`: time against vertices and objects.
"""

import os

# Times are those of one core; this has to be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
