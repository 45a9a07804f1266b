"""Sealed recordings of scenes on a base that moves, made in MuJoCo, for `poise mismatch --scene`."""
