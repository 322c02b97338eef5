"""Numbers that a file or an option holds as text."""

from __future__ import annotations

import math

from casadi_contact.files.limits import short


def finite_number(text: str, where: str) -> float:
    """The number that a file's text stands for, ValueError beginning with `where` for anything else: also for what only
    Python takes for a number (1_000, digits of other scripts)."""
    try:
        number = float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        number = None
    if number is None:
        point = " with a decimal point" if "," in text else ""
        raise ValueError(f"{where}: got {short(text)!r}, expected a number{point}")
    if not math.isfinite(number):
        raise ValueError(f"{where}: got {text}, expected a finite number")
    return number
