"""The subcommands of `poise`, one file per job; `poise.cli` puts them together.

- `output`: JSON and tables, the same way for every job.
- `identify`: weigh the payload of a recording.
- `evaluate`: do so for every recording in a folder.
"""
