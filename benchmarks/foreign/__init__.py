"""Sealed mismatch cases that MuJoCo simulates and records as real rigs do; no code is shared with the tool."""
