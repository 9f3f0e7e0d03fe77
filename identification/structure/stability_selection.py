"""Stability selection: which terms a log asks for beyond mass and damping, by sparse regression.

It never gives mass or damping. Every column is brought to unit mean square, so that no
unit decides. The log is cut into blocks; the fits with one block left out give the covariance of
the candidates whatever the colour of the residual (resampling.py), and the fits to random halves
of the blocks show which terms are asked for again and again (stability selection: Meinshausen and
Bühlmann, Journal of the Royal Statistical Society B 72, 2010, p. 417, in complementary halves:
Shah and Samworth, ibid. 75, 2013, p. 55). pysindy judges each half (sparse.py), in coordinates in
which the errors are independent.

A term is asked for if most halves ask for it, if the whole log does so by a margin that chance
does not reach, and if it is a noticeable part of the force. One file: one selection, from columns
to verdicts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.structure.collinearity import (
    ALWAYS,
    GRAVITY,
    OFFSET,
    POSITION,
    distinguishable_columns,
    normalise_columns,
    scale_to_unit_rms,
)
from identification.structure.resampling import BLOCKS, Resampled, cut_into_blocks
from identification.structure.sparse import paying_terms

FloatArray = NDArray[np.float64]

#: Random halves of the log that are looked at, in complementary pairs: frequencies in steps of
#: 1/20, and pysindy takes some six milliseconds for each.
HALVES = 20
#: A half asks for a term worth this many of its own standard deviations.
HALF_HURDLE = 2.5
#: A term is stable if this part of the halves asks for it; without a force behind it a half does
#: so once in eighty times.
STABLE = 0.7
#: The whole log must ask with this many standard deviations: about once in 3000 by chance with
#: Student's t of 59 degrees of freedom, for each of some five candidates.
HURDLE = 3.8
#: A term below this part of the rms force is not asked for however sure it is: amplifiers and
#: calibrations are no better, and mass and damping hardly notice.
LEAST_SHARE = 0.01

#: Names in the report.
_WORDS = {
    "coulomb_friction": "Coulomb friction",
    OFFSET: "a constant force or friction that differs by direction",
    POSITION: "a force in proportion to position",
    "damping_asymmetry": "damping that differs by direction",
    "quadratic_drag": "drag with the square of speed",
    GRAVITY[0]: "gravity with the sine of the angle",
    GRAVITY[1]: "gravity with its cosine",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """On one candidate; sine and cosine of gravity share theirs.

    Attributes:
        asked: whether the log asks for it.
        frequency: part of the halves of the log that ask for it, 0 to 1.
        share: its rms over the rms of the force, in the model of the terms asked for and itself.
        deviations: standard deviations that leaving it out of that model costs.
    """

    asked: bool
    frequency: float
    share: float
    deviations: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What the log asks for beyond mass and damping.

    Attributes:
        asked: names of the terms asked for, in the order of the columns.
        verdicts: on each candidate judged, by its name.
        unjudged: candidates that this motion cannot tell from mass, damping and the other terms,
            and the one of position and gravity that explains less.
        sentences: for the report.
    """

    asked: tuple[str, ...]
    verdicts: Mapping[str, Verdict]
    unjudged: tuple[str, ...]
    sentences: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Term:
    """What stands or falls as one: a candidate, or sine and cosine of gravity.

    Attributes:
        names: of its columns.
        members: their places among the candidates.
    """

    names: tuple[str, ...]
    members: tuple[int, ...]


def suggest(
    columns: Mapping[str, FloatArray], force: FloatArray, *, seed: int = 0, halves: int = HALVES
) -> Structure:
    """Terms the log asks for.

    Args:
        columns: every term of the equation of motion by its name, filtered alike; each shape
            (rows,) in a unit of its own. "mass" and "damping" are in the model anyhow; the others
            are candidates, the simplest first: of two that the motion cannot tell apart, the first
            is judged. "gravity_sine" and "gravity_cosine" are one candidate, and take the place
            of "position_stiffness" where they explain the log better.
        force: N (N·m), shape (rows,), filtered as the columns are.
        seed: of the random halves.
        halves: how many random halves.

    Raises:
        ValueError: columns that are not finite or not of the force's shape, mass or damping
            missing, too few rows, or no force.
    """
    _check(columns, force)
    table = normalise_columns(columns)
    groups, unjudged = distinguishable_columns(table)
    if not groups:
        return Structure(
            asked=(), verdicts={}, unjudged=unjudged, sentences=tuple(_sentences({}, unjudged))
        )
    places = iter(range(len(table)))
    terms = [_Term(names=group, members=tuple(next(places) for _ in group)) for group in groups]
    names = [name for group in groups for name in group]
    matrix = np.stack([table[name] for name in (*ALWAYS, *names)], axis=1)
    fits = cut_into_blocks(matrix, scale_to_unit_rms(force), nuisance=len(ALWAYS))
    terms, passed, doubt = _one_law_of_position(terms, fits)
    frequency = _frequencies(terms, fits, halves, seed)
    kept = _kept([term for term in terms if frequency[term.names] >= STABLE], fits)
    verdicts = {
        term.names: Verdict(
            asked=term in kept,
            frequency=frequency[term.names],
            share=_share(term, kept, fits),
            deviations=float(np.sqrt(_worth(term, kept, fits))),
        )
        for term in terms
    }
    sentences = list(_sentences(verdicts, unjudged))
    if doubt and any(term.names == (POSITION,) for term in kept):
        sentences.append("gravity would explain the force in proportion to position about as well")
    return Structure(
        asked=tuple(name for term in kept for name in term.names),
        verdicts={name: verdict for group, verdict in verdicts.items() for name in group},
        unjudged=unjudged + passed,
        sentences=tuple(sentences),
    )


def _check(columns: Mapping[str, FloatArray], force: FloatArray) -> None:
    missing = [name for name in ALWAYS if name not in columns]
    if missing:
        raise ValueError(f"columns must hold {' and '.join(ALWAYS)}; {missing[0]} is missing")
    # With fewer a block could not tell the terms apart.
    needed = BLOCKS * (len(columns) + 1)
    if force.ndim != 1 or force.size < needed:
        raise ValueError(f"force has shape {force.shape}; {needed} rows are needed: log for longer")
    for name, column in {"force": force, **columns}.items():
        if column.shape != force.shape:
            raise ValueError(f"{name} has shape {column.shape}, the force {force.shape}")
        if not np.all(np.isfinite(column)):
            raise ValueError(f"{name} has values that are not finite; leave those rows out")
    if not np.any(force):
        raise ValueError("the force is zero throughout; log while a force acts")


def _one_law_of_position(
    terms: list[_Term], fits: Resampled
) -> tuple[list[_Term], tuple[str, ...], bool]:
    """Terms with either position or gravity, the names passed over, and whether that is in doubt.

    Over a small range the two are alike; gravity, which is richer, must explain more by as much as
    a term must be worth.
    """
    position = next((term for term in terms if term.names == (POSITION,)), None)
    gravity = next((term for term in terms if term.names == GRAVITY), None)
    if position is None or gravity is None:
        return terms, (), False
    gain = _worth(gravity, terms, fits) - _worth(position, terms, fits)
    passed = position if gain > HURDLE**2 else gravity
    rest = [term for term in terms if term != passed]
    return rest, passed.names, bool(abs(gain) <= HURDLE**2)


def _frequencies(
    terms: Sequence[_Term], fits: Resampled, halves: int, seed: int
) -> dict[tuple[str, ...], float]:
    """Part of the halves in which pysindy asks for each term."""
    # A half knows each term with twice the variance of the whole.
    root = fits.root / np.sqrt(2)
    answers = root @ fits.halves(halves, seed).T
    members = _members(terms)
    picked = paying_terms(root[:, members], answers, HALF_HURDLE**2)
    frequency: dict[tuple[str, ...], float] = {}
    for term in terms:
        first = members.index(term.members[0])
        either = picked[:, first : first + len(term.members)].any(axis=1)
        frequency[term.names] = float(np.mean(either))
    return frequency


def _members(terms: Iterable[_Term]) -> list[int]:
    return [place for term in terms for place in term.members]


def _worth(term: _Term, kept: Sequence[_Term], fits: Resampled) -> float:
    """χ² between the kept terms with and without this one, which need not be among them."""
    others = [each for each in kept if each != term]
    return max(0.0, fits.only(_members(others))[1] - fits.only(_members([*others, term]))[1])


def _share(term: _Term, kept: Sequence[_Term], fits: Resampled) -> float:
    """Rms of a term over the rms of the force, in the model of the kept terms and this one."""
    others = [each for each in kept if each != term]
    coefficients = fits.only(_members([*others, term]))[0][-len(term.members) :]
    gram = fits.gram[np.ix_(term.members, term.members)]
    return float(np.sqrt(coefficients @ gram @ coefficients))


def _kept(terms: Sequence[_Term], fits: Resampled) -> list[_Term]:
    """The terms that the whole log asks for: sure and large enough, the weakest dropped first."""
    kept = list(terms)
    while kept:
        weakest = min(kept, key=lambda term: _worth(term, kept, fits))
        smallest = min(kept, key=lambda term: _share(term, kept, fits))
        if _worth(weakest, kept, fits) < HURDLE**2:
            kept.remove(weakest)
        elif _share(smallest, kept, fits) < LEAST_SHARE:
            kept.remove(smallest)
        else:
            break
    return kept


def _sentences(
    verdicts: Mapping[tuple[str, ...], Verdict], unjudged: tuple[str, ...]
) -> Iterable[str]:
    asked = [
        f"{_plain(names)} ({verdict.share:.1%} of the force, asked for by "
        f"{verdict.frequency:.0%} of the halves of the log)"
        for names, verdict in verdicts.items()
        if verdict.asked
    ]
    refused = [_plain(names) for names, verdict in verdicts.items() if not verdict.asked]
    if asked:
        yield f"beyond mass and damping the log asks for {'; '.join(asked)}"
    else:
        yield "the log asks for nothing beyond mass and damping"
    if refused:
        yield f"it does not ask for {', '.join(refused)}"
    if unjudged:
        yield (
            f"this motion cannot tell {_plain(unjudged)} from the other terms; "
            "a log of more range and more frequencies might"
        )


def _plain(names: tuple[str, ...]) -> str:
    return "gravity" if names == GRAVITY else " and ".join(_WORDS.get(n, n) for n in names)
