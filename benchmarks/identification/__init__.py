"""Every estimator of thesis chapter 3 side by side: `python -m benchmarks.identification.run --quick`.

- `objects`, `modular`: what is weighed. `motions`: how it is moved. `scenarios`: noise, bias, delay, seeds.
- `bounds`: how good an estimate can be. `evaluation`: trials, their errors, and averages. `run`: tables and pictures.
"""

import os

# Times are those of one core; this has to be said before numpy is loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
