"""Fake hardware: simulated arms, replayed bags and sensors with the real protocols, with injected faults."""

import poise.nodes  # noqa: F401  # Ctrl-C while the rest is imported
