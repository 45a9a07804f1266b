"""Compiled inner loops: `poise_kernels`, a library in C that is built when Poise is installed (sources in kernels/).

Each kernel has a form in Python in the room that uses it, which gives the same numbers, more slowly. That form is used
where the library is not installed (no compiler was there) or belongs to another version of Poise: `COMPILED` is then
False, and `poise --version` says so. `POISE_KERNELS=0` in the environment leaves the library out.

- `bounds`: least squares with bounds. `carving`: balls and tetrahedra. `chain`: forward kinematics.
- `clocks`: sums at many lags. `clusters`: of points. `grips`: payloads that turn. `lookup`: points in depth images.
- `matching`: surfaces moved to their points. `merging`: clusters. `neighbours`: nearest points, tetrahedra.
- `records`: records of an mcap file. `recursions`: filters and moving parts. `robust`: least squares that weigh
  outliers less. `search`: the rounds of an estimate. `slips`: first slips on a patch. `smoothing`: splines.
  `statics`: bodies in contact. `sums`: normal equations. `whitening`: of columns.
- `library`: finds and loads it. `arrays`: what is passed to it.
"""

import importlib
from typing import TYPE_CHECKING, Any

from poise.kernels.library import COMPILED

if TYPE_CHECKING:
    from poise.kernels.bounds import bounded_minimum
    from poise.kernels.carving import normals_of_planes, opened_pockets, ways_in
    from poise.kernels.chain import Chain, chain_motion
    from poise.kernels.clocks import clock_sums
    from poise.kernels.clusters import clustered_points
    from poise.kernels.grips import turned_in_grip, turned_load
    from poise.kernels.lookup import CompiledLookup, pixels_between
    from poise.kernels.matching import Drawn, matched_places
    from poise.kernels.merging import merged_clusters
    from poise.kernels.neighbours import nearest_of, side_averages, tetrahedra_of
    from poise.kernels.records import find_records
    from poise.kernels.recursions import between_stops, pendulum, rope
    from poise.kernels.robust import robust_fit
    from poise.kernels.search import CompiledSearch, SearchAnswer
    from poise.kernels.slips import first_slips
    from poise.kernels.smoothing import CompiledSplines
    from poise.kernels.statics import CompiledBodies, CompiledConeProgram, CompiledElastic, ElasticOutcome
    from poise.kernels.sums import weighed_sums
    from poise.kernels.whitening import WhiteningFilters, likely_colours

__all__ = [
    "COMPILED",
    "Chain",
    "CompiledBodies",
    "CompiledConeProgram",
    "CompiledElastic",
    "CompiledLookup",
    "CompiledSearch",
    "CompiledSplines",
    "Drawn",
    "ElasticOutcome",
    "SearchAnswer",
    "WhiteningFilters",
    "between_stops",
    "bounded_minimum",
    "chain_motion",
    "clock_sums",
    "clustered_points",
    "find_records",
    "first_slips",
    "likely_colours",
    "matched_places",
    "merged_clusters",
    "nearest_of",
    "normals_of_planes",
    "opened_pockets",
    "pendulum",
    "pixels_between",
    "robust_fit",
    "rope",
    "side_averages",
    "tetrahedra_of",
    "turned_in_grip",
    "turned_load",
    "ways_in",
    "weighed_sums",
]

_FILES = {
    "WhiteningFilters": "whitening",
    "likely_colours": "whitening",
    "CompiledBodies": "statics",
    "CompiledConeProgram": "statics",
    "CompiledElastic": "statics",
    "ElasticOutcome": "statics",
    "CompiledLookup": "lookup",
    "pixels_between": "lookup",
    "CompiledSearch": "search",
    "SearchAnswer": "search",
    "weighed_sums": "sums",
    "bounded_minimum": "bounds",
    "Chain": "chain",
    "chain_motion": "chain",
    "clock_sums": "clocks",
    "clustered_points": "clusters",
    "find_records": "records",
    "between_stops": "recursions",
    "pendulum": "recursions",
    "rope": "recursions",
    "first_slips": "slips",
    "turned_in_grip": "grips",
    "turned_load": "grips",
    "CompiledSplines": "smoothing",
    "Drawn": "matching",
    "matched_places": "matching",
    "merged_clusters": "merging",
    "nearest_of": "neighbours",
    "side_averages": "neighbours",
    "tetrahedra_of": "neighbours",
    "normals_of_planes": "carving",
    "opened_pockets": "carving",
    "ways_in": "carving",
    "robust_fit": "robust",
}


def __getattr__(name: str) -> Any:
    """Load a kernel on first use (PEP 562): `poise --version` asks for `COMPILED`, and does not load numpy."""
    if name not in _FILES:
        raise AttributeError(f"module 'poise.kernels' has no attribute {name!r}")
    globals()[name] = getattr(importlib.import_module(f"poise.kernels.{_FILES[name]}"), name)
    return globals()[name]
