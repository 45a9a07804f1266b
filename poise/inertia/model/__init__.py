"""The physics of a rigid payload, and the problem and the solution that all estimators share.

- `parameters`: `InertialParameters`, the vector phi (10,), the pseudo-inertia, changes of frame.
- `wrench_regressor`, `signals`: the wrench of a moving load, linear in phi.
- `parts`, `object_shape`, `spread_points`: the shape of a held object as homogeneous parts.
- `problem`: `NoiseLevels`, `IdentificationProblem`. `solution`: `InertialSolution`, `EstimateFinding`.
- `sample_checks`, `rejection`: samples that cannot be used, with reasons. `metrics`: errors of an estimate.
"""

from poise.inertia.model.object_shape import (
    CLOUD_ACCURACY,
    ObjectShape,
    cloud_accuracy,
    load_object,
    parts_of_segmentation,
    parts_of_solid,
)
from poise.inertia.model.parameters import (
    PARAMETER_NAMES,
    UPPER,
    InertialParameters,
    about_com_jacobian,
    frame_change,
    phi_of_pseudo_inertia,
    pseudo_inertia,
    symmetric,
)
from poise.inertia.model.parts import Parts
from poise.inertia.model.problem import UNKNOWN_NOISE, IdentificationProblem, NoiseLevels
from poise.inertia.model.rejection import RejectionLog
from poise.inertia.model.sample_checks import NOT_FINITE, OUT_OF_ORDER, SampleChecks
from poise.inertia.model.signals import (
    ENTRIES,
    N_MOTION,
    N_SIGNALS,
    N_UNKNOWNS,
    NormalEquations,
    believable,
    log_likelihood,
    mixed,
    motion_signals,
    normal_equations,
    residual_covariance,
    residual_moments,
    signal_columns,
)
from poise.inertia.model.solution import EstimateFinding, InertialSolution, RejectedInterval, root_mean_square
from poise.inertia.model.spikes import SPIKE, SpikeFilter
from poise.inertia.model.wrench_regressor import regressor

__all__ = [
    "CLOUD_ACCURACY",
    "ENTRIES",
    "NOT_FINITE",
    "N_MOTION",
    "N_SIGNALS",
    "N_UNKNOWNS",
    "OUT_OF_ORDER",
    "PARAMETER_NAMES",
    "SPIKE",
    "UNKNOWN_NOISE",
    "UPPER",
    "EstimateFinding",
    "IdentificationProblem",
    "InertialParameters",
    "InertialSolution",
    "NoiseLevels",
    "NormalEquations",
    "ObjectShape",
    "Parts",
    "RejectedInterval",
    "RejectionLog",
    "SampleChecks",
    "SpikeFilter",
    "about_com_jacobian",
    "believable",
    "cloud_accuracy",
    "frame_change",
    "load_object",
    "log_likelihood",
    "mixed",
    "motion_signals",
    "normal_equations",
    "parts_of_segmentation",
    "parts_of_solid",
    "phi_of_pseudo_inertia",
    "pseudo_inertia",
    "regressor",
    "residual_covariance",
    "residual_moments",
    "root_mean_square",
    "signal_columns",
    "symmetric",
]
