"""Recordings with a concealed effect, made by another engine than the tool's, and what `poise mismatch` says of them.

- `robot`, `motions`, `payload`: a UR10 on a Ridgeback for MuJoCo, what it does and what it carries.
- `engine`: MuJoCo moves it and measures the wrench. `scene`: what a case is before anything is wrong with it.
- `changes/`: what may be wrong, as hooks into engine and sensor chain. `honest`: what is never quite right.
- `recorder`: samples, noise, clocks, the bag. `plan`: which cases there are. `case`: one of them, whole.
- `seals`: labels put away. `make`, `run`, `score`: the three commands. `tally`, `table`, `confusion`: the score.
- `calibrate`: the weights of the stated probabilities.
- `portrait`: the picture of docs/concealed.md.

See README.md here for the conventions of every effect.
"""

import os

# Cases are made and judged on one core each; this has to be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
