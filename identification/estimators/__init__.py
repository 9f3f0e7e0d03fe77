"""Estimators, one file each, named as on the command line and entered at its ``fit``.

``fit(table, delay, fits_delay=...) -> Estimate`` takes a log as least_squares.prepare gives it; the
delay, s, is what the log has or where its fit begins. ``point`` finds the same without intervals.
"""

from __future__ import annotations

from typing import Literal, get_args

#: What may be asked for: the method that the evidence allows, or an estimator by its name.
Method = Literal["auto", "least-squares", "instruments", "output-error", "innovations"]
METHODS: tuple[Method, ...] = get_args(Method)
ESTIMATORS: tuple[Method, ...] = METHODS[1:]
#: Those that are given a delay; the others fit one if nobody states it.
GIVEN_A_DELAY = frozenset[str]({"least-squares"})
