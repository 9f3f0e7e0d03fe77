"""How others identify a mass with damping and an offset from a servo's log.

Each takes a log and its delay in s, a whole number of samples, and gives mass and damping, shape
(2,). Written from the references named, none of it shared with the estimators.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import butter, lfilter, sosfiltfilt

from benchmarks.other_methods import arriving
from identification import Trajectory

FloatArray = NDArray[np.float64]

#: Rows at either end that a zero-phase filter has not settled in, periods of its cut-off.
_UNSETTLED = 1.0
#: Rate b/m where searches begin, 1/s, and rounds of refined instruments.
_RATE, _ROUNDS = 1.0, 8
#: Samples of one shooting interval.
_INTERVAL = 200


def one_filter(trajectory: Trajectory, delay: float, cut_off: float) -> FloatArray:
    """Least squares on central differences, one zero-phase Butterworth on both sides.

    What robotics does (Gautier, Janot, Vandanjon, IEEE Transactions on Control Systems Technology
    21, 2013, p. 428); the cut-off is in Hz.
    """
    step = trajectory.sample_time
    velocity = np.gradient(trajectory.position, step)
    force = arriving(trajectory, delay)
    # Held over the step that follows a sample, and differences are centred on the sample.
    centred = (force + np.concatenate((force[:1], force[:-1]))) / 2
    columns = (np.gradient(velocity, step), velocity, np.ones_like(velocity), centred)
    filtered = sosfiltfilt(butter(2, cut_off, fs=1 / step, output="sos"), np.stack(columns))
    edge = max(2, round(_UNSETTLED / cut_off / step))
    inner: FloatArray = np.array(filtered, dtype=np.float64)[:, edge:-edge]
    table: FloatArray = np.stack(list(inner[:3]), axis=1)
    right: FloatArray = np.array(inner[3], dtype=np.float64)
    found: FloatArray = np.asarray(np.linalg.lstsq(table, right, rcond=None)[0], dtype=np.float64)
    return found[:2]


def _held(force: FloatArray, rate: float, step: float) -> FloatArray:
    """Position of 1/(s·(s + rate)) under a held force from rest, exact at the samples."""
    decay = float(np.exp(-rate * step))
    gained = -np.expm1(-rate * step) / rate
    moved = (step - gained) / rate
    above = [0.0, moved, gained * gained - moved * decay]
    return np.asarray(lfilter(above, [1.0, -1 - decay, decay], force), dtype=np.float64)


def _coasting(rate: float, step: float, samples: int) -> FloatArray:
    """Start in place and in speed, shape (2, samples)."""
    return np.stack((np.ones(samples), -np.expm1(-rate * step * np.arange(samples)) / rate))


def output_error(trajectory: Trajectory, delay: float) -> FloatArray:
    """The simulated position fitted to the measured one by scipy.optimize.least_squares."""
    step, place = trajectory.sample_time, trajectory.position
    force = arriving(trajectory, delay)

    def missed(values: FloatArray) -> FloatArray:
        rate = float(np.exp(values[1]))
        start = values[3:] @ _coasting(rate, step, place.size)
        return np.exp(values[0]) * _held(force - values[2], rate, step) + start - place

    begun = np.array([0.0, np.log(_RATE), 0.0, float(place[0]), 0.0])
    found = least_squares(missed, begun, x_scale="jac", method="trf")
    mass = float(np.exp(-found.x[0]))
    return np.array([mass, mass * float(np.exp(found.x[1]))])


def srivc(trajectory: Trajectory, delay: float) -> FloatArray:
    """Simplified refined instrumental variables for a continuous-time model.

    Regression of filtered derivatives, tested against those of the simulated position (Young and
    Jakeman 1979; Garnier and Wang, Identification of Continuous-time Models from Sampled Data,
    2008, chapter 4). The filter is the inverse of the denominator s·(s + p) as it is known so far.
    """
    step, place = trajectory.sample_time, trajectory.position
    force = arriving(trajectory, delay)
    mass, rate, offset = 1.0, _RATE, 0.0
    start = np.array([float(place[0]), 0.0])
    for turn in range(_ROUNDS):
        simulated = _held(force - offset, rate, step) / mass
        simulated = simulated + start @ _coasting(rate, step, place.size)
        known = np.stack(
            (*_coasting(rate, step, place.size), _held(np.ones_like(force), rate, step))
        )
        driven = _held(force, rate, step)
        bent, slow = _derivatives(place, rate, step)
        free, tested = slow, _derivatives(simulated, rate, step)[1] if turn else slow
        columns = np.stack((driven, -free, *known))
        tests = np.stack((driven, -tested, *known))
        found = np.linalg.solve(tests @ columns.T, tests @ bent)
        mass, rate, offset = 1 / found[0], max(float(found[1]), 1e-6), -float(found[4] / found[0])
        left = place - _held(force - offset, rate, step) / mass
        coasting = _coasting(rate, step, place.size)
        start = np.asarray(np.linalg.lstsq(coasting.T, left, rcond=None)[0], dtype=np.float64)
    return np.array([mass, mass * rate])


def _derivatives(place: FloatArray, rate: float, step: float) -> tuple[FloatArray, FloatArray]:
    """s/(s + p) and 1/(s + p) of a position that goes straight from sample to sample."""
    decay = float(np.exp(-rate * step))
    gained = -np.expm1(-rate * step) / rate
    late = (step - gained) / (rate * step)
    above = [late, gained - late]
    slow = np.asarray(lfilter(above, [1.0, -decay], place - place[0]), dtype=np.float64)
    return place - place[0] - rate * slow, slow


def multiple_shooting(trajectory: Trajectory, delay: float) -> FloatArray:
    """CasADi and IPOPT: starts of every interval are unknown, and intervals must meet.

    Bock's method (Bock 1981), Runge-Kutta of order four from sample to sample.
    """
    import casadi

    api: Any = casadi
    step = trajectory.sample_time
    count = len(trajectory) // _INTERVAL
    place = trajectory.position[: count * _INTERVAL].reshape(count, _INTERVAL)
    force = arriving(trajectory, delay)[: count * _INTERVAL].reshape(count, _INTERVAL)
    size = float(np.std(place))
    state, pushed, model = api.MX.sym("state", 2), api.MX.sym("force"), api.MX.sym("model", 3)

    def slope(at: Any) -> Any:
        pull = pushed - model[2]
        return api.vertcat(at[1], api.exp(model[0]) * pull / size - api.exp(model[1]) * at[1])

    first = slope(state)
    second = slope(state + step / 2 * first)
    third = slope(state + step / 2 * second)
    fourth = slope(state + step * third)
    after = state + step / 6 * (first + 2 * second + 2 * third + fourth)
    sample = api.Function("sample", [state, pushed, model], [after, state[0]])
    interval = sample.mapaccum("interval", _INTERVAL)
    starts, parameters = api.MX.sym("starts", 2, count), api.MX.sym("parameters", 3)
    shared = api.repmat(parameters, 1, _INTERVAL * count)
    ended, seen = interval.map(count)(starts, api.DM(force.ravel()).T, shared)
    ends = ended[:, _INTERVAL - 1 :: _INTERVAL]
    missed = seen - api.DM(place.ravel() / size).T
    program = {
        "x": api.vertcat(parameters, api.vec(starts)),
        "f": api.sumsqr(missed),
        "g": api.vec(ends[:, :-1] - starts[:, 1:]),
    }
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    solver = api.nlpsol("solver", "ipopt", program, quiet)
    speeds = np.gradient(trajectory.position, step)[: count * _INTERVAL : _INTERVAL]
    begun = np.stack((place[:, 0], speeds)) / size
    begun = np.concatenate(([0.0, np.log(_RATE), 0.0], begun.T.ravel()))
    found = np.asarray(solver(x0=begun, lbg=0, ubg=0)["x"]).ravel()
    mass = float(np.exp(-found[0]))
    return np.array([mass, mass * float(np.exp(found[1]))])
