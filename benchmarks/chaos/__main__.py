"""Runs the table of nodes and faults: `python -m benchmarks.chaos`."""

from benchmarks.chaos.run import main

main()
