"""One log to one estimate: its most excited part, the terms it asks for, the method believed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from types import ModuleType

import numpy as np

from identification.device.hardware import Hardware, SuggestedFacts
from identification.device.quantities import Quantity, quantity
from identification.errors import Finding
from identification.estimators import GIVEN_A_DELAY
from identification.estimators.estimate import (
    Estimate,
    Gravity,
    Model,
    PointEstimate,
    contradiction,
    half_width,
    region,
    wald,
)
from identification.estimators.filters import Rest, is_coloured
from identification.estimators.least_squares import (
    CUT_OFF_RANGE,
    Delay,
    Regression,
    find_delay,
    longest_delay,
    prepare,
    shift_of_delay,
)
from identification.estimators.motion import distinguishable_terms
from identification.findings import contradicts_delay, judge
from identification.findings.force_balance import balance_of
from identification.findings.forces import inertia_of
from identification.fitting.early_force import (
    ROWS,
    acts_early,
    averaged,
    rows_early,
    seems_measured,
)
from identification.fitting.log_fit import LogFit
from identification.trajectory import NORMAL_95, FloatArray, Trajectory, encoder_count, most_excited

_DELAY_STEP = 0.05  # change of delay, in samples, for the slope of the estimates over delay


@dataclass(frozen=True, kw_only=True)
class PreparedLog:
    """A prepared log and its estimates."""

    trajectory: Trajectory  # the log
    table: Regression  # prepared regression; its model is that of every estimate
    rough: Regression  # the same before the delay was found and the direction of motion refined
    stated: Quantity | None  # delay of the hardware; None if it has none, or the log contradicts it
    found: Delay | None  # delay read from the log, or None if it was stated
    delay: float  # stated or found, s
    doubt: float  # standard deviation of the delay, s
    made: dict[str, Estimate] = field(default_factory=dict[str, Estimate])  # estimates by method

    @classmethod
    def of(cls, trajectory: Trajectory, model: Model, stated: Quantity | None) -> PreparedLog:
        """Find the direction of motion, and the delay unless it is stated and not contradicted."""
        step = trajectory.sample_time
        longest = longest_delay(step, len(trajectory))
        # Forces from before the log are left out up to the longest delay that is looked at.
        room = longest if stated is None else stated.value + _DELAY_STEP * step
        rough = prepare(trajectory, model, room, refine=False)
        found = cls._from_rough(trajectory, rough, stated)
        if stated is None:
            return found
        shift = shift_of_delay(found.table, stated.value)
        seen = replace(shift, value=stated.value + shift.value)
        wrong = seen.value < longest and contradicts_delay(seen, stated, step)
        other = cls.of(trajectory, model, None) if wrong else found
        return found if wrong and found.left_by_friction() <= other.left_by_friction() else other

    @classmethod
    def _from_rough(
        cls, trajectory: Trajectory, rough: Regression, stated: Quantity | None
    ) -> PreparedLog:
        found = None
        if stated is None:
            found = find_delay(trajectory, rough)
            delay, doubt = found.value, found.deviation
            # A fitted delay may move by a sample; rows that know all forces until then are back.
            step = trajectory.sample_time
            table = rough.with_delays_to(min(delay + step, longest_delay(step, len(trajectory))))
        else:
            delay, doubt = stated.value, (stated.high - stated.low) / (2 * NORMAL_95)
            table = rough
        # From the first look on, where turns seen at other delays leave nothing behind.
        return cls(
            trajectory=trajectory,
            table=table.refined(delay),
            rough=rough,
            stated=stated,
            found=found,
            delay=delay,
            doubt=doubt,
        )

    def believing(self, stated: Quantity | None) -> PreparedLog:
        """This log with a delay stated that it may contradict."""
        return PreparedLog._from_rough(self.trajectory, self.rough, stated)

    def widened(self, model: Model) -> PreparedLog:
        """This log with more terms: without them delay and direction may have gone astray."""
        return PreparedLog._from_rough(self.trajectory, self.rough.with_model(model), self.stated)

    def narrowed(self, model: Model) -> PreparedLog:
        """This log prepared with fewer terms, which the delay does not miss."""
        if model == self.model:
            return self
        table = self.table.with_model(model).refined(self.delay)
        return replace(self, table=table, made={})

    @property
    def model(self) -> Model:
        """Terms of every estimate."""
        return self.table.model

    @cached_property
    def rest(self) -> Rest:
        """What least squares leaves of the force."""
        table, step, found = self.table, self.table.signals.step, self.fit("least-squares")
        if isinstance(table.signals.steps, np.ndarray):
            return Rest()
        noise = found.value("mass") * table.signals.noise / step**2
        turned = np.diff(np.sign(table.motion.direction.mean()))
        feigned = found.value("coulomb_friction") ** 2 * float(np.mean(turned**2))
        return Rest.of(found.residual, table.cut_off.frequency * step, noise, feigned)

    @cached_property
    def structured(self) -> bool:
        """Whether what is left may be more than noise and a white force."""
        from identification.fitting.friction_curve import follows_motion

        return self.rest.structured or follows_motion(self.table, self.delay)

    @property
    def pushed(self) -> bool:
        """Whether forces that nobody logged move the device beyond doubt."""
        return self.table.is_loud(self.delay) and self.rest.pushed

    @property
    def has_reference(self) -> bool:
        """Whether the log carries the set-point the device followed."""
        return self.table.signals.reference is not None

    def fit(self, method: str) -> Estimate:
        """The estimate of one method, made at most once."""
        if method not in self.made:
            self.made[method] = self._fit(method)
        return self.made[method]

    def point(self, table: Regression, method: str) -> PointEstimate:
        """The point estimate of one method from this log with other terms or another filter."""
        return _estimator(method).point(table, self.delay, fits_delay=self._fits_delay(method))

    def left_by_friction(self) -> float:
        """Rms over that of the force of what friction beyond the model leaves over at this delay.

        Friction with a memory is late, as a delay is.
        """
        from identification.fitting.friction_curve import friction_curve

        curve = friction_curve(self.table, self.delay)
        left = max(1 - self.fit("least-squares").explained, 0.0) ** 0.5
        return left if curve is None else curve.left

    def _fits_delay(self, method: str) -> bool:
        return self.stated is None and method not in GIVEN_A_DELAY

    def _fit(self, method: str) -> Estimate:
        estimator, fits_delay = _estimator(method), self._fits_delay(method)
        found = estimator.fit(self.table, self.delay, fits_delay=fits_delay)
        if fits_delay or self.doubt == 0:
            return found
        # A delay of d looks like an added damping of -m·ω²·d: often most of the interval.
        step = _DELAY_STEP * self.trajectory.sample_time
        slope = (estimator.point(self.table, self.delay + step).values - found.values) / step
        added = self.doubt**2 * np.outer(slope, slope)
        return replace(found, covariance=found.covariance + added)


def _estimator(method: str) -> ModuleType:
    """The file of one method; only those that a log needs are loaded."""
    return import_module(f"identification.estimators.{method.replace('-', '_')}")


#: A residual of at most this many counts rms is the encoder's own, whatever its colour: rounding
#: alone is 0.289, and it is not white where the device moves slowly.
_ENCODER_RESIDUAL = 0.295
#: Distance of a residual's cumulated spectrum from white up to which the intervals of output error
#: still hold, although an octave is in excess: what the model misses is then small beside noise.
_NEARLY_WHITE = 0.025
#: ... or this over the root of half its rows, which white noise exceeds once in a hundred times.
_WHITE_BY_CHANCE = 1.63
#: Methods whose answers are heard where another is believed; output error is then astray.
CONSULTED = ("innovations", "instruments")
#: Instruments whose joint region is this many times that of least squares have nothing to say
#: against an estimate that least squares would.
_POWERLESS = 2.0
#: Areas of two regions, each of jackknifed variances, are told apart below this ratio.
_SHARPER = 0.75


def noise_explains(prepared: PreparedLog) -> str | None:
    """A sentence if position noise explains what output error leaves, or None.

    Gravity is taken at the measured position, and what noise does to it is a force of its own.
    Where least squares give no positive mass there is nothing to start output error from.
    """
    starts = prepared.fit("least-squares").value("mass") > 0
    if prepared.model.gravity != "none" or not starts or prepared.pushed:
        return None
    return explained_by_noise(prepared.fit("output-error").residual, prepared.trajectory)


def explained_by_noise(residual: FloatArray, trajectory: Trajectory) -> str | None:
    """A sentence if noise of its readings explains a residual of a log's position, m, or None."""
    if not is_coloured(residual):
        return "its residual is white in every octave"
    count = encoder_count(trajectory.position)
    counts = float(np.sqrt(np.mean(residual**2))) / (count or np.inf)
    if 0 < counts <= _ENCODER_RESIDUAL:
        return (
            f"its residual is {counts:.2f} encoder counts rms (at most {_ENCODER_RESIDUAL:g}), no "
            "more than rounding"
        )
    return None


def choose(prepared: PreparedLog, method: str, explained: str | None) -> tuple[Estimate, str]:
    """The estimate to believe and why; output error where position noise explains the rest."""
    regression = prepared.fit("least-squares")
    starts = regression.value("mass") > 0
    if method == "least-squares" or (method != "auto" and starts):
        return prepared.fit(method), f"{method.replace('-', ' ')} as asked"
    if not starts:
        return regression, "least squares, because it gives no positive mass to start others from"
    if prepared.model.gravity != "none" or prepared.pushed:
        return robust(prepared)
    simulated = prepared.fit("output-error")
    if explained is not None:
        judge = prepared.fit("instruments") if prepared.has_reference else simulated
        if judge.value("mass") <= 0 or not contradiction(simulated, judge):
            return simulated, f"output error, because {explained}"
    chosen, reason = robust(prepared)
    chance = _WHITE_BY_CHANCE / np.sqrt(simulated.residual.size / 2)
    mild = simulated.whiteness <= max(_NEARLY_WHITE, chance)
    if mild and region(simulated) < region(chosen) and not contradiction(simulated, chosen):
        return simulated, (
            f"output error, because its residual is only {simulated.whiteness:.2f} from white and "
            f"its intervals, which carry that, are narrower than those of {chosen.method}"
        )
    return chosen, reason


def robust(prepared: PreparedLog) -> tuple[Estimate, str]:
    """The estimate to believe where forces act that the log does not know.

    The one that leans on least comes first, and another takes its place only if its joint region of
    mass and damping is no larger and Hausman's test finds no contradiction; docs/theory.md, 7. What
    follows a set-point under a white force is left to least squares and instruments.
    """
    candidates = _robust_ones(prepared)
    judge = candidates[0]
    # Least squares where they are not contradicted, or instruments where those are sharper.
    usual = max(candidates, key=lambda each: each.method == "least-squares")
    sharpest = min(candidates, key=region)
    default = sharpest if region(sharpest) < _SHARPER * region(usual) else usual
    if prepared.has_reference and prepared.pushed and not prepared.rest.structured:
        # Least squares weigh it best, but do not fit a delay.
        best = default if prepared.stated is None else usual
        return best, f"{_named(best)}, because what is left is like a white force"
    predicted = prepared.fit("innovations")
    apart = contradiction(predicted, judge)
    found = predicted.settled and predicted.value("mass") > 0
    sharper = found and region(predicted) <= region(default)
    told = inertia_of(balance_of(prepared.trajectory, predicted)) if sharper else None
    wrong = [told is not None and told.contradicts(each) for each in (predicted, default)]
    if any(wrong) and not all(wrong):
        right = default if wrong[0] else predicted
        return right, (
            f"{_named(right)}, because the mass that rows at equal velocity tell contradicts the "
            "other"
        )
    if sharper and not apart:
        return predicted, (
            "innovations, because noise of the position does not explain all that is left, they "
            f"know mass and damping best, and {_named(judge)} do not contradict"
        )
    why = "innovations know mass and damping less well"
    if not predicted.settled:
        why = "innovations did not settle"
    if apart:
        why = (
            f"innovations say {apart} of {_named(judge)}: the friction or another force is not "
            "what the model has"
        )
    if prepared.has_reference and len(candidates) == 1 and judge.method == "instruments":
        why += "; least squares, which noise in the force biases, contradict instruments"
    return default, f"{_named(default)}, because {why}"


def over_cut_offs(prepared: PreparedLog, estimate: Estimate) -> Estimate:
    """Instruments with what half and twice the cut-off move, as least squares have it already."""
    if estimate.method != "instruments":
        return estimate
    table = prepared.table
    middle = table.cut_off.frequency
    low, high = (
        prepared.point(table.at_cut_off(each), "instruments").values
        for each in (middle / CUT_OFF_RANGE, middle * CUT_OFF_RANGE)
    )
    choice_shift = (high - low) / 2
    covariance = estimate.covariance + np.outer(choice_shift, choice_shift)
    return replace(estimate, covariance=covariance, choice_shift=choice_shift)


def _robust_ones(prepared: PreparedLog) -> tuple[Estimate, ...]:
    """Estimates that do not lean on what colours the rest; the first judges the others.

    Instruments where a reference is logged, unless they know so little that they could not
    contradict, and least squares unless instruments contradict them.
    """
    regression = prepared.fit("least-squares")
    if not prepared.has_reference:
        return (regression,)
    # What follows a set-point is free of the noise that a feedback puts into the force.
    instrumental = prepared.fit("instruments")
    if instrumental.value("mass") <= 0:
        return (regression,)
    if contradiction(regression, instrumental):
        return (instrumental,)
    if region(instrumental) <= _POWERLESS * region(regression):
        return instrumental, regression
    return regression, instrumental


def _named(estimate: Estimate) -> str:
    return estimate.method.replace("-", " ")


def suggested_by(fits: Sequence[LogFit]) -> SuggestedFacts:
    """What logs suggest of the facts that a person has to state."""
    delays = [fit.delay for fit in fits if fit.delay is not None]
    return SuggestedFacts(
        logs=tuple(fit.trajectory for fit in fits),
        delays=tuple((each.value, each.deviation) for each in delays),
    )


def fit_log(trajectory: Trajectory, hardware: Hardware, method: str) -> LogFit:
    """Estimate mass, damping and friction from one log, behind the lag stated or what it shows."""
    stated = hardware.current_lag
    free = _fit(trajectory, hardware.model_copy(update={"current_lag": None}), method)
    if stated is None:
        return free
    from identification.fitting import stated_lag

    given = _fit(*stated_lag.behind(trajectory, hardware, stated), method)
    return stated_lag.believed(free, given, stated)


def _fit(trajectory: Trajectory, hardware: Hardware, method: str, *, rigid: bool = False) -> LogFit:
    """The estimate from one log, of a ``rigid`` device or not."""
    stated = hardware.delay
    part = most_excited(trajectory)
    prepared, structure = PreparedLog.of(part, distinguishable_terms(part), stated), ""
    early = acts_early(part, prepared.table, prepared.delay)
    most = longest_delay(trajectory.sample_time, len(trajectory))
    untold = Delay(value=0.0, deviation=most / np.sqrt(12)) if stated is None else None
    if early is not None and early.value < ROWS * trajectory.sample_time:
        at_once = hardware.model_copy(update={"delay": quantity(0.0)})
        again = _fit(averaged(trajectory), at_once, method, rigid=rigid)
        return replace(
            again,
            trajectory=trajectory,
            delay=untold,
            findings=(*again.findings, seems_measured(trajectory, early)),
        )
    explained = noise_explains(prepared)
    if explained is None:
        prepared, structure = _add_paying_terms(prepared)
        explained = noise_explains(prepared)
    regression, curve = prepared.fit("least-squares"), None
    plausible = regression.value("mass") > 0
    if explained is None and plausible:
        from identification.fitting.friction_curve import friction_curve

        structured = prepared.structured
        curve = friction_curve(prepared.table, prepared.delay, structured=structured)
    # A lag looks like a delay that contradicts the one stated.
    late = stated is not None and prepared.stated is None
    seen = prepared.believing(stated) if late else prepared
    asked = not rigid and early is None and plausible and (explained is None or late)
    if asked and seen.table.is_loud(seen.delay) and seen.structured:
        from identification.fitting.dynamics import find_dynamics

        least = np.inf if curve is None or late else curve.left**2
        found = find_dynamics(part, seen.table, seen.delay, hardware, least=least)
        if found is not None:
            again = _fit(found.log, hardware, method, rigid=True)
            return replace(
                again,
                trajectory=trajectory,
                estimate=found.carried_by(again.estimate, seen.fit("least-squares")),
                findings=(*again.findings, *found.findings),
                dynamics=found,
            )
    chosen, reason = choose(prepared, method, explained)
    chosen = _drop_noise_terms(prepared, over_cut_offs(prepared, chosen))
    beyond: tuple[Finding, ...] = () if early is None else (rows_early(trajectory, early),)
    if curve is not None:
        from identification.fitting.friction_curve import unmodelled

        chosen = curve.carried_by(chosen)
        beyond += (unmodelled(trajectory, curve, chosen.value("damping")),)
    if len(part) < len(trajectory):
        reason += f"; from the {len(part)} samples that move most of {len(trajectory)}"
    delay = prepared.found if early is None else None
    if delay is not None and chosen.delay_deviation is not None:  # the chosen method knows it best
        delay = replace(delay, value=chosen.delay, deviation=chosen.delay_deviation)
    others = tuple(each for each in prepared.made.values() if each.method != chosen.method)
    return LogFit(
        trajectory=trajectory,
        fitted=len(part),
        estimate=chosen,
        others=others,
        delay=delay if early is None else untold,
        findings=judge(
            trajectory,
            regression,
            chosen,
            delay=delay,
            stated=stated,
            consulted=[each for each in others if each.method in CONSULTED],
            unexplained=1.0 if curve is None else curve.left,
        )
        + beyond,
        reason=reason,
        structure=structure,
        curve=curve,
    )


#: A friction term smaller than its own standard deviation is left out. A higher hurdle would move
#: mass and damping by more than their intervals where the term is real.
_ASKED_FOR = 1.0
#: ... by the estimate believed, or by least squares with at most this many times its deviation.
_AS_WELL = 1.25
#: Friction cannot be negative. Down to this many deviations below zero it is nothing but chance;
#: below that something else is wrong, and it stays for all to see.
_NEGATIVE_BY_CHANCE = 3.0
#: A rotary axis that swings further, rad, is taken for a pendulum, another for one on a spring, ...
_WIDE_SWING = 0.5
#: ... unless the other law leaves less than this part of the mean square that this one leaves.
_BETTER_LAW = 0.9


def _add_paying_terms(prepared: PreparedLog) -> tuple[PreparedLog, str]:
    """The log with those further terms that pay for themselves, and what sparse regression says.

    For a log of which position noise does not explain all. Friction by direction and a law of
    position stay if they pay in least squares and in the estimate believed, and if sparse
    regression on halves of the log asks for them too.
    """
    model = prepared.model
    plausible = prepared.fit("least-squares").value("mass") > 0
    wide = _with_law_of_position(prepared)
    largest = wide.model
    groups = [
        names
        for names in (("damping_asymmetry",), largest.of_gravity)
        if set(names) <= set(largest.parameters) and _pays(wide.fit("least-squares"), names)
    ]
    if not groups:
        return prepared, ""
    wide = wide.widened(_with(model, groups, largest))
    estimate, _ = robust(wide)
    paying = {names: _pays(estimate, names) for names in groups}
    # A controller looks like a spring against the motion: only a weight may turn the sign of mass.
    weight = largest.gravity == "pendulum" or estimate.value("position_stiffness") > 0
    if not any(paying.values()) or not (plausible or (estimate.value("mass") > 0 and weight)):
        return prepared, ""
    from identification.fitting.stability_selection import second_opinion

    asked, said = second_opinion(wide.table, wide.delay, [each for each in groups if paying[each]])
    found = _with(model, asked, largest)
    return prepared if found == model else wide.narrowed(found), said


def _with_law_of_position(prepared: PreparedLog) -> PreparedLog:
    """The log with friction by direction and the law of position that explains it best."""
    model, trajectory = prepared.model, prepared.trajectory
    laws: list[Gravity] = ["proportional"]
    if trajectory.motion == "rotary":
        laws.insert(int(np.ptp(trajectory.position) <= _WIDE_SWING), "pendulum")
    model = replace(model, directional=model.coulomb and model.offset, gravity=laws[0])
    usual = prepared.narrowed(model)
    for law in laws[1:]:
        other = usual.narrowed(replace(model, gravity=law))
        left, before = (1 - each.fit("least-squares").explained for each in (other, usual))
        if left < _BETTER_LAW * before:
            return other
    return usual


def _with(model: Model, groups: Collection[tuple[str, ...]], largest: Model) -> Model:
    """The model with those further groups of the terms of the largest."""
    gravity = largest.gravity if largest.of_gravity in groups else "none"
    return replace(model, directional=("damping_asymmetry",) in groups, gravity=gravity)


def _pays(estimate: Estimate, names: tuple[str, ...]) -> bool:
    """Whether terms are worth their price in Schwarz's criterion (Annals of Statistics 6, 1978)."""
    index = [estimate.parameters.index(name) for name in names]
    square = wald(estimate.values[index], estimate.covariance[np.ix_(index, index)])
    return square > np.log(estimate.residual.size) * len(index)


def _drop_noise_terms(prepared: PreparedLog, estimate: Estimate) -> Estimate:
    """The estimate without friction terms that are nothing but noise.

    The covariance stays that of the whole model: leaving a term out must not make the others look
    better known than they are.
    """
    model = estimate.model
    if model.directional:
        return estimate

    regression = prepared.fit("least-squares")

    def is_noise(name: str, below: float) -> bool:
        most = _AS_WELL * estimate.deviation(name)
        known = [each for each in (estimate, regression) if each.deviation(name) <= most]
        return any(
            -below * each.deviation(name) <= each.value(name) < _ASKED_FOR * each.deviation(name)
            for each in known
        )

    reduced = replace(
        model,
        coulomb=model.coulomb and not is_noise("coulomb_friction", _NEGATIVE_BY_CHANCE),
        offset=model.offset and not is_noise("force_offset", _ASKED_FOR),
    )
    if reduced == model:
        return estimate
    smaller = prepared.point(prepared.table.with_model(reduced), estimate.method)
    left = dict(zip(reduced.parameters, smaller.values.tolist(), strict=True))
    values = np.array([left.get(name, 0.0) for name in estimate.parameters])
    dropped = [name for name in estimate.parameters if name not in reduced.parameters]
    notes = tuple(
        f"{name} left out: {estimate.value(name):.2g} ± {half_width(estimate, name):.2g}"
        for name in dropped
    )
    return replace(
        estimate,
        values=values,
        residual=smaller.residual,
        explained=smaller.explained,
        notes=estimate.notes + notes,
    )
