"""Model `limit`: limit analysis with exact Coulomb cones at the corners of every interface, one small SOCP per load."""

from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.equilibrium import corner_rows
from poise.assembly.statics.load_factor import LoadFactorProgram
from poise.assembly.statics.solvers import SOLVER_TOLERANCE


def limit_program(
    geometry: BlockGeometry, tolerance: float = SOLVER_TOLERANCE, order: Elimination | None = None
) -> LoadFactorProgram:
    """Inverse load factors of a block whose contact forces lie in |t| <= mu n at each corner (thesis eq. 4.7, 4.11)."""
    return LoadFactorProgram(corner_rows(geometry, -geometry.gravity.ravel(), equal=False), tolerance, order)
