"""Models and planners that others proposed, to compare with; registries find them by name.

- `models`: robustness models, over `robustness`: sampled contacts, flows, cuts and linear programs.
- `planners`: placement planners, over `placement`: a physics engine and the trial of whole poses.
"""

__all__: list[str] = []
