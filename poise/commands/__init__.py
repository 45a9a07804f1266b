"""The subcommands of `poise`, one file per job; `poise.cli` puts them together.

- `output`: JSON and tables, in the same form for every job.
- `identify`: weigh the payload of a recording. `evaluate`: weigh that of every recording in a folder.
- Every other file: the subcommand of its name, or what several subcommands share.
"""
