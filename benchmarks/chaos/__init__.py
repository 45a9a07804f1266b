"""Every node under every fault that a robot sees, a soak of the whole graph, and a fuzzer of all interfaces.

- `processes`: nodes as real processes, with their memory, their output and limits.
- `observer`: the node of the benchmark that feeds, calls and watches the others.
- `hostile`: messages with hostile values, made from the definition of any message.
- `subjects`: for each node how it is started, fed and known to answer right.
- `faults`: what is done to a node; `run`: every node x every fault, and the table of docs/reliability.md.
- `soak`: sensor, arm, estimator, diagnoser and limits at 1 kHz; memory per hour, messages that are lost.
- `fuzz`: thousands of hostile requests against the message layer, hundreds through DDS.

Run `python -m benchmarks.chaos`, `python -m benchmarks.chaos.soak` and `python -m benchmarks.chaos.fuzz`; each has
`--quick` and `--help`.
"""
