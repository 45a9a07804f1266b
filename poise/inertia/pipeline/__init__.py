"""One weighing pipeline for a running robot and for a recording.

- `online`: `OnlineEstimator`, wrenches and motion stream in; `method_pipeline`: one method at work.
- `live`: `LiveEstimator`, which takes messages as they arrive; `status`: its diagnostics.
- `identification`: `identify`, which feeds a recording to the pipeline. `estimate`: the answer.
"""

from poise.inertia.pipeline.estimate import Identification, InertialEstimate
from poise.inertia.pipeline.identification import METHODS, identify, identify_wrenches, recorded_gravity
from poise.inertia.pipeline.live import IMUS, SOURCES, LiveEstimator, LiveOptions
from poise.inertia.pipeline.online import OnlineEstimator
from poise.inertia.pipeline.samples import RecordedSamples
from poise.inertia.pipeline.status import status_of

__all__ = [
    "IMUS",
    "METHODS",
    "SOURCES",
    "Identification",
    "InertialEstimate",
    "LiveEstimator",
    "LiveOptions",
    "OnlineEstimator",
    "RecordedSamples",
    "identify",
    "identify_wrenches",
    "recorded_gravity",
    "status_of",
]
