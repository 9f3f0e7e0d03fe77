"""What people do without haptune: finite differences, an ARX fit, pysindy.

Each takes a log, the terms beside mass and damping, and the delay in s, and gives mass and damping,
shape (2,). All of them take samples as evenly spaced and the delay as whole samples.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory
from identification.estimators.estimate import Model

FloatArray = NDArray[np.float64]

#: A term that carries less than this part of the acceleration is dropped by pysindy: of those here,
#: none that matters to mass and damping, and the ones that do not exist go.
_SPARSE = 0.01


def arriving(trajectory: Trajectory, delay: float) -> FloatArray:
    """The force that acts from each sample on, shape (n,); before the log its first value did."""
    whole = round(delay / trajectory.sample_time)
    return trajectory.force[np.maximum(np.arange(len(trajectory)) - whole, 0)]


def finite_differences(trajectory: Trajectory, model: Model, delay: float) -> FloatArray:
    """What a first script does: differentiate twice, shift the force, solve."""
    step, position = trajectory.sample_time, trajectory.position
    acceleration = np.diff(position, 2) / step**2
    velocity = (position[2:] - position[:-2]) / (2 * step)
    columns = [acceleration, velocity]
    columns += [np.sign(velocity)] if model.coulomb else []
    columns += [np.ones_like(velocity)] if model.offset else []
    force = arriving(trajectory, delay)[1:-1]
    found = np.linalg.lstsq(np.stack(columns, axis=1), force, rcond=None)[0]
    return np.asarray(found[:2], dtype=np.float64)


def arx(trajectory: Trajectory, model: Model, delay: float) -> FloatArray:
    """q[k] = a1·q[k-1] + a2·q[k-2] + b1·F[k-1] + b2·F[k-2] + ..., by least squares.

    The poles of the held 1/(s(m·s + b)) are 1 and e^(-bT/m), so their product -a2 gives b/m, and
    the velocity under a lasting force, (b1 + b2)/(T·(1 - e^(-bT/m))) = 1/b, gives b.
    """
    step, position = trajectory.sample_time, trajectory.position
    force = arriving(trajectory, delay)
    columns = [position[1:-1], position[:-2], force[1:-1], force[:-2]]
    columns += [np.sign(np.diff(position)[:-1])] if model.coulomb else []
    columns += [np.ones_like(position[2:])] if model.offset else []
    sizes = [float(np.linalg.norm(column)) or 1.0 for column in columns]
    table = np.stack([c / s for c, s in zip(columns, sizes, strict=True)], axis=1)
    weights = np.linalg.lstsq(table, position[2:], rcond=None)[0] / sizes
    decay, push = -weights[1], weights[2] + weights[3]
    if not 0 < decay != 1:
        return np.full(2, np.nan)
    damping = step * (1 - decay) / push
    return np.array([-damping * step / np.log(decay), damping])


def pysindy_fit(trajectory: Trajectory, model: Model, delay: float) -> FloatArray:
    """SINDy with control: (q, v)' from 1, q, v, F and sign(v), on normalised columns.

    v is pysindy's smoothed difference of q. Columns are normalised and the threshold is a part of
    the acceleration, because as delivered it is absolute and a change of units would drop F.
    """
    import pysindy

    sindy: Any = pysindy

    step = trajectory.sample_time
    time = step * np.arange(len(trajectory))
    differentiate = sindy.SmoothedFiniteDifference()
    position = trajectory.position[:, None]
    velocity: FloatArray = np.asarray(differentiate(position, time), dtype=np.float64)
    acceleration: FloatArray = np.asarray(differentiate(velocity, time), dtype=np.float64)
    library = sindy.PolynomialLibrary(degree=1, include_bias=model.offset)
    if model.coulomb:
        signs = sindy.CustomLibrary(library_functions=[_sign])
        library = sindy.GeneralizedLibrary([library, signs], inputs_per_library=[[0, 1, 2], [1]])
    fit = sindy.SINDy(
        optimizer=sindy.STLSQ(
            threshold=_SPARSE * float(np.linalg.norm(acceleration)),
            alpha=0.0,
            normalize_columns=True,
        ),
        feature_library=library,
        differentiation_method=differentiate,
    )
    # The force is held over the step that follows a sample, and differences are centred on it.
    force = arriving(trajectory, delay)
    centred = (force + np.concatenate((force[:1], force[:-1]))) / 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit.fit(np.hstack((position, velocity)), t=time, u=centred, feature_names=["q", "v", "F"])
    names: list[str] = fit.get_feature_names()
    row = np.asarray(fit.coefficients(), dtype=np.float64)[1]
    per_mass, per_velocity = row[names.index("F")], row[names.index("v")]
    if per_mass == 0:
        return np.full(2, np.nan)
    return np.array([1 / per_mass, -per_velocity / per_mass])


def _sign(values: FloatArray) -> FloatArray:
    """numpy.sign as a plain function, which pysindy wants."""
    return np.sign(values)


OTHERS = {"finite differences": finite_differences, "ARX": arx, "pysindy": pysindy_fit}
