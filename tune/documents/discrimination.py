"""Counts of a same-different study → d', and d' → the chance that two settings are told apart.

Equal-range signal detection: the difference felt between two settings is s + noise of variance 1.
A person answers "equal" while it lies within ±c, otherwise "higher" or "lower" by its sign, so

    P(equal | s) = Φ(c − s) − Φ(−c − s),   P(right sense | s) = Φ(s − c),   P(wrong) = Φ(−s − c).

At s = 0 the first is 2Φ(c) − 1, which gives the criterion c; for the pair that was shown s is d'.
Weber's law makes s proportional to the logarithm of the ratio: s = d'·ln(ratio)/ln(ratio shown).
The criterion is a habit of the people who answered, d' is what they felt. Model: Macmillan and
Creelman, Detection Theory (from memory); it takes "higher" and "lower" to be equally liked.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import expm1, inf, log, log1p
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from identification import Document

FloatArray = NDArray[np.float64]

#: Points of each of the two rates over which intervals are taken; more changes them by < 0.1 %.
_NODES = 200
#: Half-widths of intervals: 95 %.
_TAILS = (0.025, 0.975)
#: A Weber fraction beyond this is no threshold: the study showed too small a difference.
_LARGEST_FRACTION = 10.0
#: d' as good as none, and the largest power of e worth telling: what is beyond is no number.
_GUESSING, _MOST = 1e-9, 700.0
_NORMAL = NormalDist()


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its 95 % interval; None where its source gives no interval."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """Chances of the three answers to one pair of settings; they sum to 1."""

    right: Estimate
    equal: Estimate
    wrong: Estimate


class Study(Document):
    """One cell of a same-different study: how often each kind of pair was judged rightly.

    Attributes:
        equal_right: equal pairs that were called equal, of ``equal_trials``.
        different_right: different pairs that were called different in the right sense, of
            ``different_trials``.
        lower: the lesser of the two settings shown, as felt (device included), SI.
        upper: the greater.
    """

    equal_right: int = Field(gt=0)
    equal_trials: int = Field(gt=0)
    different_right: int = Field(gt=0)
    different_trials: int = Field(gt=0)
    lower: float = Field(gt=0)
    upper: float = Field(gt=0)

    @model_validator(mode="after")
    def _informative(self) -> Study:
        for right, trials in (
            (self.equal_right, self.equal_trials),
            (self.different_right, self.different_trials),
        ):
            if right >= trials:
                raise ValueError(
                    f"{right} of {trials} right bounds no threshold; more trials would, for "
                    "different pairs a smaller difference too"
                )
        if self.upper <= self.lower:
            raise ValueError(f"upper {self.upper:g} must exceed lower {self.lower:g}")
        if self.sensitivity() <= log(self.ratio) / log1p(_LARGEST_FRACTION):
            raise ValueError(
                f"d' is {self.sensitivity():.2g}: the different pairs were told hardly better than "
                "by guessing, which bounds no threshold; a larger difference would"
            )
        return self

    @property
    def ratio(self) -> float:
        """Ratio of the two settings shown, above 1."""
        return self.upper / self.lower

    def criterion(self) -> float:
        """c, in units of the noise: 2Φ(c) − 1 = P(equal | equal)."""
        return _NORMAL.inv_cdf((1 + self.equal_right / self.equal_trials) / 2)

    def sensitivity(self) -> float:
        """d' of the pair shown, in units of the noise: c + Φ⁻¹(P(right | different))."""
        return self.criterion() + _NORMAL.inv_cdf(self.different_right / self.different_trials)

    def weber_fraction(self) -> float:
        """w = ratio^(1/d') − 1: the relative step at d' = 1, told in 84 % of forced choices."""
        return expm1(log(self.ratio) / self.sensitivity())

    def weber_estimate(self) -> Estimate:
        """The Weber fraction with its 95 % interval; above 1e300 where it may all be guessing."""
        criterion, shift = self._draws()
        least, most = _interval(criterion + shift)
        low, high = (expm1(min(log(self.ratio) / max(d, _GUESSING), _MOST)) for d in (most, least))
        return Estimate(value=self.weber_fraction(), low=low, high=high)

    def forced_choice(self, ratio: float) -> Estimate:
        """Chance to say rightly which of two settings is greater when "equal" is no answer: Φ(s).

        Args:
            ratio: of the two settings as felt, positive; its inverse means the same.
        """
        units = self._units(ratio)
        criterion, shift = self._draws()
        low, high = _interval(_phi(units * (criterion + shift)))
        return Estimate(value=_NORMAL.cdf(units * self.sensitivity()), low=low, high=high)

    def answers(self, ratio: float) -> Answers:
        """Chances of the answers this study's people would give to a pair of settings.

        At the ratio shown they are the shares observed, with the interval of those shares alone.

        Args:
            ratio: of the two settings as felt, positive; its inverse means the same.
        """
        units = self._units(ratio)
        c, s = self.criterion(), units * self.sensitivity()
        criterion, shift = self._draws()
        # s − c is written so that it is the observed shift itself where units is 1.
        beyond = (units - 1) * criterion + units * shift
        below = -beyond - 2 * criterion
        right, wrong = _phi(beyond), _phi(below)
        return Answers(
            right=_estimate(_NORMAL.cdf(s - c), right),
            equal=_estimate(_NORMAL.cdf(c - s) - _NORMAL.cdf(-c - s), 1 - right - wrong),
            wrong=_estimate(_NORMAL.cdf(-c - s), wrong),
        )

    def _draws(self) -> tuple[FloatArray, FloatArray]:
        """c, shape (n, 1), and Φ⁻¹(P(right|different)), shape (1, n), at equally likely points."""
        from scipy.special import ndtri

        equal = _rates(self.equal_right, self.equal_trials)
        different = _rates(self.different_right, self.different_trials)
        return np.asarray(ndtri((1 + equal) / 2))[:, None], np.asarray(ndtri(different))[None, :]

    def _units(self, ratio: float) -> float:
        if not 0 < ratio < inf:
            raise ValueError(f"a ratio of settings is positive and finite, not {ratio:g}")
        return abs(log(ratio)) / log(self.ratio)


@lru_cache(maxsize=32)
def _rates(right: int, trials: int) -> FloatArray:
    """A rate at equally likely points of its posterior under Jeffreys' prior, shape (n,).

    Beta(right + ½, wrong + ½) gives intervals that miss the truth about as often as they say, and
    to both sides alike; percentiles of resampled counts lean towards hands finer than they are.
    """
    from scipy.special import betaincinv

    levels = (np.arange(_NODES) + 0.5) / _NODES
    rates: FloatArray = np.asarray(betaincinv(right + 0.5, trials - right + 0.5, levels))
    rates.flags.writeable = False
    return rates


def _phi(values: FloatArray) -> FloatArray:
    from scipy.special import ndtr

    return np.asarray(ndtr(values))


def _estimate(value: float, draws: FloatArray) -> Estimate:
    low, high = _interval(draws)
    return Estimate(value=value, low=low, high=high)


def _interval(draws: FloatArray) -> tuple[float, float]:
    # Draws stand for the middle of equal parts of probability, which is Hazen's rule.
    low, high = np.quantile(draws, _TAILS, method="hazen")
    return float(low), float(high)
