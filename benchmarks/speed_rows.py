"""Output error by length of the log, its preparation included: even stamps and uneven ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.long_log import DAMPING, DELAY, MASS, long_log
from benchmarks.row import Row, best_seconds
from identification import Trajectory, quantity
from identification.estimators.estimate import Estimate, Model
from identification.fitting import PreparedLog

_MODEL = Model(coulomb=True, offset=True)


def rows() -> Iterator[Row]:
    """Friction, offset and a known delay; the error shows that the timed fit is a fit."""
    even: dict[int, float] = {}
    for uneven in (False, True):
        for samples, repeats in ((5_000, 5), (1_000_000, 2)):
            log = long_log(samples, uneven=uneven)
            kept: list[Estimate] = []
            seconds = best_seconds(lambda log=log, kept=kept: kept.append(_fit(log)), repeats)
            found = np.array([kept[-1].value("mass"), kept[-1].value("damping")])
            error = np.abs(found / (MASS, DAMPING) - 1)
            against = f"{seconds / even[samples]:.2g} times even stamps" if uneven else ""
            if not uneven:
                even[samples] = seconds
                if samples > min(even):
                    against = f"{seconds / even[min(even)]:.0f} times {min(even)} samples"
            yield Row(
                what=f"output error, {samples} samples, {'uneven' if uneven else 'even'} stamps",
                seconds=seconds,
                error=f"one log: m {error[0]:.1e}, b {error[1]:.1e}",
                against=against,
            )


def _fit(log: Trajectory) -> Estimate:
    return PreparedLog.of(log, _MODEL, quantity(DELAY)).fit("output-error")
