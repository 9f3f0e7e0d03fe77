"""The parts of the benchmarks, each measured when it is asked for."""

from __future__ import annotations

from importlib import import_module

from benchmarks.section import Section

#: In the order of the pages.
PARTS = (
    "identification",
    "servo",
    "stability",
    "robustness",
    "tuning",
    "steps",
    "scene",
    "scaling",
    "memory",
    "commands",
)

_SCENE = """\
What each part of a scene or of a device costs: the same scene with it and without, in turn. What
a scene does not ask for is not computed.
"""
_STEPS = """\
What tuning spends its time on: sizes proposed, described, certified; cut-offs chosen; first
calls in a new process, imports included.
"""
_SCALING = """\
From one element to hundreds and from one device to many: time of one processor, for fleets by
the clock, and the power of their number that it grows with.
"""
_MEMORY = """\
Logs of a million rows read, and the most memory beyond what Python and the libraries take;
output error on short and long logs, even stamps and uneven ones. Memory of the estimators beside
their peers stands with the logs of a million samples in [identification](identification.md); of
a hundred million verdicts in [stability](stability.md).
"""
_TUNING = """\
The largest product of perceived steps: by how much the logarithm of the product stays behind the
best that 30 independent searches know, against time. All solvers are given the same rows,
slopes, start and binding corners, except "closed form" and "largest product", which is what
`tune` does: starts and corners looked for, answers compared, moved inside. Gaps below 1e-12 are
drawn there.
"""
_TUNING_REASONS = {
    "largest product": "it looks for its own starts and for the corners of the box that bind, "
    "which the solvers are given here, and makes two of them agree.",
    "IPOPT": "a general interior-point method; asked beside SLSQP because it fails elsewhere.",
    "nlopt SLSQP": "same method, same slopes; the last digits differ.",
}
#: Title, text and modules of the parts that have no picture.
_OF_ROWS = {
    "steps": ("Tuning: its steps apart", _STEPS, ("tuning_rows",)),
    "scene": ("Scenes: what each part costs", _SCENE, ("scene_rows",)),
    "scaling": ("Scaling: many elements and devices", _SCALING, ("scaling_rows",)),
    "memory": ("Memory: long logs", _MEMORY, ("reading_rows", "speed_rows")),
}


def measured(part: str) -> Section:
    """Measure one part."""
    if part == "tuning":
        return _tuning()
    if part in _OF_ROWS:
        title, text, modules = _OF_ROWS[part]
        rows = (row for each in modules for row in import_module(f"benchmarks.{each}").rows())
        return Section(name=part, title=title, text=text, rows=tuple(rows))
    return import_module(f"benchmarks.{part}_section").measure()


def _tuning() -> Section:
    from benchmarks.solver_cells import cells

    found = tuple(cells())
    seconds = {(cell.case, cell.method): cell.seconds or 0.0 for cell in found}
    ratios = {
        f"largest product over scipy SLSQP, {case}": seconds[case, "largest product"]
        / seconds[case, "scipy SLSQP"]
        for case in dict.fromkeys(cell.case for cell in found)
        if (case, "largest product") in seconds
    }
    return Section(
        name="tuning",
        title="Tuning: gap to the largest product, against time",
        text=_TUNING,
        cells=found,
        error="gap of the logarithm of the product",
        floor=1e-12,
        reasons=_TUNING_REASONS,
        ratios=ratios,
    )
