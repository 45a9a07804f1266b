"""Reports, pictures and Rerun recordings of results. No node uses it; drawing libraries load on first use.

- `report`, `mismatch_report`, `loop_report`, `evaluation_report`: self-contained HTML pages. `page` is their skeleton,
  `inline_svg` puts figures into it.
- `rerun_scene`, `mismatch_scene`, `assembly_recording`: recordings for the Rerun viewer (needs rerun-sdk, an extra).
- `figures`, `*_figures`: the panels of reports and pictures. `canvas`: what all panels share, and picture files.
- `summary`, `wording`: a result as numbers and sentences; how numbers and external names are written.
"""

import importlib
from typing import TYPE_CHECKING, Any

from poise.viewing.wording import readable, rounded

if TYPE_CHECKING:
    from poise.viewing.assembly_figures import graph_panel, limits_panel, map_panel, mechanism_panel
    from poise.viewing.assembly_recording import write_assembly_recording
    from poise.viewing.canvas import write_picture
    from poise.viewing.carried_figures import carried_panels
    from poise.viewing.carrying_figures import transfer_panel
    from poise.viewing.evaluation_report import write_evaluation_report
    from poise.viewing.excitation_figures import excitation_panels
    from poise.viewing.loop_report import LOOP_COLUMNS, loop_rows, loop_sentences, write_loop_report
    from poise.viewing.mismatch_report import write_mismatch_report
    from poise.viewing.mismatch_scene import write_mismatch_scene
    from poise.viewing.parts_picture import draw_parts
    from poise.viewing.report import write_identification_report
    from poise.viewing.rerun_scene import write_identification_recording
    from poise.viewing.rollout_report import rollout_rows, write_rollout_report
    from poise.viewing.summary import parameter_rows

__all__ = [
    "LOOP_COLUMNS",
    "carried_panels",
    "draw_parts",
    "excitation_panels",
    "graph_panel",
    "limits_panel",
    "loop_rows",
    "loop_sentences",
    "map_panel",
    "mechanism_panel",
    "parameter_rows",
    "readable",
    "rollout_rows",
    "rounded",
    "transfer_panel",
    "write_assembly_recording",
    "write_evaluation_report",
    "write_identification_recording",
    "write_identification_report",
    "write_loop_report",
    "write_mismatch_report",
    "write_mismatch_scene",
    "write_picture",
    "write_rollout_report",
]

_FILES = {
    "LOOP_COLUMNS": "loop_report",
    "carried_panels": "carried_figures",
    "draw_parts": "parts_picture",
    "excitation_panels": "excitation_figures",
    "loop_rows": "loop_report",
    "loop_sentences": "loop_report",
    "parameter_rows": "summary",
    "rollout_rows": "rollout_report",
    "transfer_panel": "carrying_figures",
    "write_assembly_recording": "assembly_recording",
    "write_evaluation_report": "evaluation_report",
    "write_identification_recording": "rerun_scene",
    "write_identification_report": "report",
    "write_loop_report": "loop_report",
    "write_mismatch_report": "mismatch_report",
    "write_mismatch_scene": "mismatch_scene",
    "write_picture": "canvas",
    "write_rollout_report": "rollout_report",
}


def __getattr__(name: str) -> Any:
    """Import the file of a name on first use (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module 'poise.viewing' has no attribute {name!r}")
    file = importlib.import_module(f"poise.viewing.{_FILES.get(name, 'assembly_figures')}")
    globals()[name] = getattr(file, name)
    return globals()[name]
