"""Published models and planners for comparison; registries find them by name.

- `models`: robustness models, which use `robustness`: sampled contacts, flows, cuts and linear programs.
- `planners`: placement planners, which use `placement`: a physics engine, and tests of sampled poses.
"""

__all__: list[str] = []
