"""Numbers and foreign names as a person should read them."""

import math
import re
import unicodedata

NOT_IDENTIFIABLE = "not identifiable from this motion"


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Write a value to the digits its uncertainty leaves meaningful: two significant digits of sigma.

    Args:
        value: any unit.
        sigma: one standard deviation in the same unit; NaN or 0 when it is not known.

    Returns:
        Value and sigma; sigma is empty when not known, and the value then has four significant digits.
    """
    if not math.isfinite(value):
        return NOT_IDENTIFIABLE, ""
    if not (math.isfinite(sigma) and sigma > 0):
        return _unsigned_zero(f"{value:.4g}"), ""
    decimals = 1 - math.floor(math.log10(sigma))
    if decimals > 9:
        exponent = math.floor(math.log10(max(abs(value), sigma)))
        digits = max(0, decimals + exponent)
        return f"{value / 10.0**exponent:.{digits}f}e{exponent}", f"{sigma / 10.0**exponent:.{digits}f}e{exponent}"
    decimals = max(0, decimals)
    return _unsigned_zero(f"{value:.{decimals}f}"), f"{sigma:.{decimals}f}"


def readable(text: str, limit: int = 200) -> str:
    """Make a name from outside fit to be shown: no control or direction-changing characters, no endless length.

    Such characters (NUL, escape sequences, lone surrogates, right-to-left overrides) become U+FFFD. Escaping for
    HTML is not done here: the template does it.
    """
    kept = text[:limit]
    shown = "".join("\ufffd" if unicodedata.category(letter) in ("Cc", "Cf", "Cs") else letter for letter in kept)
    return f"{shown}… ({len(text) - limit} more characters)" if len(text) > limit else shown


def counted(number: int, noun: str) -> str:
    """'1 sample', '2 samples'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _unsigned_zero(number: str) -> str:
    """-0.00 is 0.00."""
    return re.sub(r"^-(?=0*\.?0*$)", "", number)
