"""From poses that a camera sees, with their uncertainty, to poses that touch.

- `settle`: the most likely poses, and others drawn from what is known (`Settled`).
- `rows`, `belief`: distances between bodies, and the Gaussian of all poses conditioned on them.
- `facets`, `candidates`, `contact_choice`: where bodies may touch, and where they do. `separation`: keeps others apart.
"""

from poise.assembly.settling.settle import Move, Settled, settle

__all__ = ["Move", "Settled", "settle"]
