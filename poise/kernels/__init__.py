"""Compiled inner loops: `poise_kernels`, a library in C that is built when Poise is installed (sources in kernels/).

Each kernel has a form in Python in the room that uses it, which gives the same numbers, more slowly. That form is used
where the library is not installed (no compiler was there) or belongs to another version of Poise: `COMPILED` is then
False, and `poise --version` says so. `POISE_KERNELS=0` in the environment leaves the library out.

- `library`: finds and loads it.
- `chain`: forward kinematics. `records`: records of an mcap file. `smoothing`: splines through samples.
"""

from poise.kernels.chain import Chain, chain_motion
from poise.kernels.library import COMPILED
from poise.kernels.records import find_records
from poise.kernels.smoothing import CompiledSplines

__all__ = ["COMPILED", "Chain", "CompiledSplines", "chain_motion", "find_records"]
