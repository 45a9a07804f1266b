"""Forces in one block of the contact interface graph: equilibrium, limit analysis, patches and elastic contacts.

- `block`, `block_solvers`: a block as numbers, and all solvers of it.
- `equilibrium`, `load_factor`, `limit`: conic programs over contact forces (`solvers` calls the conic solver).
- `patch`, `single_patch`, `friction_surface`: friction of patches under uniform pressure. `coulomb`,
  `elastic_contacts`, `elastic_state`: elastic contacts.
- `pushes`: loads. `analysis`: an assembly prepared for many queries. `changes`: updates after a change of the assembly.
- `rolling`: what stands, but can roll. `symmetry`: what carries a block into itself.
"""

from poise.assembly.statics.analysis import (
    Analysis,
    BlockAnalysis,
    Mechanism,
    PatchMechanism,
    Stability,
    unstable,
)
from poise.assembly.statics.block import BlockGeometry, block_geometry
from poise.assembly.statics.changes import analysis_after, begin_near, same_object
from poise.assembly.statics.coulomb import FACTOR_TOLERANCE
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.elastic_state import ElasticFactor
from poise.assembly.statics.equilibrium import contact_forces, polygon_rows
from poise.assembly.statics.friction_surface import patch_friction
from poise.assembly.statics.load_factor import UNLIMITED, InverseLoadFactor
from poise.assembly.statics.pushes import Loads, Push, loads_of, surface_distance
from poise.assembly.statics.rolling import ROLLING_TOGETHER, Rolling, rolling, too_many_to_roll
from poise.assembly.statics.single_patch import hull_edges
from poise.assembly.statics.symmetry import Symmetry

__all__ = [
    "FACTOR_TOLERANCE",
    "NO_DEADLINE",
    "ROLLING_TOGETHER",
    "UNLIMITED",
    "Analysis",
    "BlockAnalysis",
    "BlockGeometry",
    "Deadline",
    "ElasticFactor",
    "InverseLoadFactor",
    "Loads",
    "Mechanism",
    "PatchMechanism",
    "Push",
    "Rolling",
    "Stability",
    "Symmetry",
    "analysis_after",
    "begin_near",
    "block_geometry",
    "contact_forces",
    "hull_edges",
    "loads_of",
    "patch_friction",
    "polygon_rows",
    "rolling",
    "same_object",
    "surface_distance",
    "too_many_to_roll",
    "unstable",
]
