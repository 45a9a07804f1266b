"""Model `limit`: limit analysis with exact Coulomb cones at the corners of every interface, one small SOCP per load."""

import numpy as np

from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.equilibrium import moving_into_cones, stacked
from poise.assembly.statics.load_factor import LoadFactorProgram
from poise.assembly.statics.solvers import SOLVER_TOLERANCE, Cones


def limit_program(geometry: BlockGeometry, tolerance: float = SOLVER_TOLERANCE) -> LoadFactorProgram:
    """Inverse load factors of a block whose contact forces lie in |t| <= mu n at each corner (thesis eq. 4.7, 4.11)."""
    corners = len(geometry.points)
    matrix = stacked(-geometry.gravity.reshape(1, -1), -moving_into_cones(geometry))
    right = np.concatenate([[1.0], np.zeros(3 * corners)])
    cones = Cones(nonnegative=1, second_order=(3,) * corners)
    return LoadFactorProgram(matrix, right, cones, 6 * geometry.count, tolerance)
