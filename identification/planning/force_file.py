"""A planned force as the controller reads it: CSV with the columns time and force, SI units."""

from __future__ import annotations

from identification.excitation import Excitation

#: Significant digits: a nanosecond in three minutes, and more than the force was rounded to.
_DIGITS = 12


def force_text(excitation: Excitation) -> str:
    """One row a sample; the force of each is held until the next, the first and last are zero."""
    rows = zip(excitation.time.tolist(), excitation.best.force.tolist(), strict=True)
    lines = (f"{time:.{_DIGITS}g},{force + 0.0:.{_DIGITS}g}" for time, force in rows)
    return "\n".join(("time,force", *lines)) + "\n"
