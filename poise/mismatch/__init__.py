"""Where simulation and reality part, what physics was left out, and the proof.

- `model`: model.yaml: payload, tolerances, noise, and the effects that a diagnosis added.
- `world`: one recording as effects see it.
- `load`: the wrench of a rigid load and its derivatives.
- `effects/`: the library, one file per effect.
"""
