"""Fake hardware: simulated arms, replayed bags and sensors with the real protocols, with injected faults."""
