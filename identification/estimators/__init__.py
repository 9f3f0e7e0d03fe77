"""Estimators, one file each, named as on the command line and entered at its ``fit``.

``fit(table, delay, start=...) -> Estimate`` takes a log as least_squares.prepare gives it; where
the delay is None it is fitted too, from ``start`` on. Least squares alone needs to be given one.
"""

from __future__ import annotations

from typing import Literal, get_args

#: What may be asked for: the method that the evidence allows, or an estimator by its name.
Method = Literal["auto", "least-squares", "instruments", "output-error", "innovations"]
METHODS: tuple[Method, ...] = get_args(Method)
ESTIMATORS: tuple[Method, ...] = METHODS[1:]
#: Those that are given a delay; the others fit one if nobody states it.
GIVEN_A_DELAY = frozenset[str]({"least-squares"})
