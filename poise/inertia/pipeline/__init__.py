"""One weighing pipeline for a running robot and for a recording.

- `method_pipeline`: `MethodPipeline`, samples of one estimator; `estimator_group`: the estimators of one method.
- `online`: `OnlineEstimator`, which takes streams of wrenches and motion.
- `live`: `LiveEstimator`, which takes messages as they arrive; `live_options`: its settings; `status`: its diagnostics.
- `identification`: `identify`, which feeds a recording to the pipeline. `estimate`: the answer.
- `segments`: payloads of a recording, each weighed; `payload_changes`, `block_means`, `block_sums`: the
  search for their changes.
"""

from poise.inertia.pipeline.estimate import Identification, InertialEstimate, PayloadSegment
from poise.inertia.pipeline.identification import identify, identify_wrenches, recorded_gravity
from poise.inertia.pipeline.live import LiveEstimator
from poise.inertia.pipeline.live_options import FLUSH_AFTER, IMUS, SOURCES, LiveOptions
from poise.inertia.pipeline.online import OnlineEstimator
from poise.inertia.pipeline.status import status_of

__all__ = [
    "FLUSH_AFTER",
    "IMUS",
    "SOURCES",
    "Identification",
    "InertialEstimate",
    "LiveEstimator",
    "LiveOptions",
    "OnlineEstimator",
    "PayloadSegment",
    "identify",
    "identify_wrenches",
    "recorded_gravity",
    "status_of",
]
