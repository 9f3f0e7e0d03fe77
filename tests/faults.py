"""Gate of faults: one-line faults, each of which some default test has to notice.

    python -m tests.faults              # all of them, two at a time: some minutes
    python -m tests.faults ripple apart # those whose names hold a word

Each is put into a copy of the tree, in which the tests named beside it, which pass without it, are
run until one fails. Ends with 1 unless every fault is caught. What notices a fault goes through a
public verb, a command or `certify`.
"""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).parents[1]
_AT_ONCE = 2
_LONGEST = 300  # s, of the tests of one fault


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One line changed.

    Attributes:
        name: what is no longer so.
        file: in which.
        old: text that stands there once.
        new: in its place.
        tests: what pytest is given, of which one test has to fail.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str


def _of(file: str, tests: str, *faults: tuple[str, str, str]) -> tuple[Fault, ...]:
    return tuple(
        Fault(name=name, file=file, old=old, new=new, tests=tests) for name, old, new in faults
    )


_EDGES = "tests/test_edges.py"
_GUARD = "tests/test_guard_law.py"

FAULTS: tuple[Fault, ...] = (
    # The condition of the clamps.
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k beside_a_wall",
        ("coupling of clamps and switches", " * 0.25\n", " * 0.0\n"),
        ("levels of what fades", "zip(terms[sides:], sum_.steady, strict=True)", "zip((), ())"),
        ("levels up to the gain", "len(begun)), claim.gain)", "len(begun)), 1.0)"),
        ("coupling beside a line", " + self.whole * self.less * 4.0", ""),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k wall_",
        ("the gain in the own terms", "real * (1 / (gain * size))", "real * (1 / size)"),
        ("the extra delay of a clamp", "(gain=0.0, extra=claim.extra)", "(gain=0.0, extra=0.0)"),
        ("a constant where a device is held", "* whole + channel.constant)", "* whole + 1.0)"),
        ("a circle behind a line", "centre - root.centre.real - wide", "centre - wide"),
        ("the width of a cell behind a line", "root.centre.real - wide - lost", "root.centre.real"),
    ),
    # What a wall and what it meets give up for each other.
    *_of(
        "tune/optimisation/saturation.py",
        "tests/test_clamps.py -k 'block_whose or leave_room or exponential'",
        ("taps as long as a clamp lags", "min(_LAGS * lag, LONGER)", "0.0"),
        ("taps of a whole exponential", "_ALL_LAGS * lag * long)", "0.0)"),
        (
            "steps that a wall gives up",
            "max((spare for _, _, spare in springs), default=0.0)",
            "0.0",
        ),
    ),
    *_of(
        "tune/optimisation/solve.py",
        "tests/test_clamps.py -k next_to_nothing",
        ("a wall that is next to nothing", "sizes, most) > MOST_LOST", "sizes, most) > 1e9"),
    ),
    *_of(
        "tune/optimisation/problem.py",
        "tests/test_clamps.py -k leave_room",
        ("what is met gives up more where both are asked for", "0.8, (0.6, 0.4, 0.2)", "0.8, ()"),
    ),
    *_of(
        "tune/certificate/zero_exclusion.py",
        "tests/test_zero_exclusion.py -k add_up",
        ("all of an extra delay", "high + extra * step", "high + 0.5 * extra * step"),
        ("all pieces of a delay", "in pairwise(ends.tolist())", "in [(ends[0], ends[1])]"),
    ),
    *_of(
        "tune/certificate/value_set.py",
        "tests/test_zero_exclusion.py -k forms_hold",
        ("the heaviest hand", "high / (light + weight * high)", "low / (light + weight * low)"),
        ("inertia of a hand beside that of all", " - denominator * self.handle) * self.share", ")"),
        ("damping of the hand among aliases", ".hand[1] * lighter, ", ".hand[1] * lighter * 0.0, "),
    ),
    *_of(
        "tune/certificate/affine.py",
        "tests/test_zero_exclusion.py -k near_a_line",
        ("the bend of an inverse", "error = at_ends - at_root - slope", "error = -slope"),
    ),
    *_of(
        "tune/certificate/zero_exclusion.py",
        "tests/test_zero_exclusion.py -k 'every_pair or any_mass'",
        ("the stiffest hand", "way * (stiff - soft) + soft\n", "way * 0.0 + soft\n"),
        ("the lightest hand", " * -(heavy - light) + heavy", " * -0.9 * (heavy - light) + heavy"),
        ("the way of a hand", "[float(wide), 0.0]", "[0.5, 0.0]"),
        ("masses at aliases by the way", " = np.maximum(heavy - ", " = np.maximum(heavy - 0.5 * "),
    ),
    *_of(
        "tune/optimisation/__init__.py",
        "tests/test_optimise.py -k left_out_and_the_rest",
        ("a proof that is spent", "in SLACK[2 * error.spent : end] if", "in SLACK[:end] if"),
    ),
    *_of(
        "tune/optimisation/proved.py",
        "tests/test_clamps.py -k two_percent_more",
        (
            "less lag where proofs hold back",
            "_LESS_LAG, _RAISED = 1.25",
            "_LESS_LAG, _RAISED = 1.0",
        ),
    ),
    *_of(
        "tune/optimisation/proved.py",
        "tests/test_clamps.py -k held_back",
        (
            "raising what a proof held back",
            "while found is not before",
            "while False",
        ),
        (
            "a raise that is proved",
            "return None\n        found[place]",
            "pass\n        found[place]",
        ),
    ),
    *_of(
        "tune/optimisation/saturation.py",
        "tests/test_clamps.py -k one_signal",
        ("multipliers of other clamps", "            multiplier = None  #", "            pass  #"),
    ),
    *_of(
        "tune/cli/preparation.py",
        "tests/test_rehearse.py -k ripple_of_both",
        ("ripple beside a wall", "told * meets_wall(design, combination)", "0.0"),
    ),
    *_of(
        "tune/certificate/value_set.py",
        "tests/test_zero_exclusion.py -k any_mass",
        ("aliases over all mass", "if self.hand is None else stacked.", "if True else stacked."),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k false_multiplier",
        (
            "taps alone where nothing holds",
            "if bool(channel.constant) != grounded or not (channel.taps or grounded):",
            "if not channel.taps and not grounded:",
        ),
        ("a multiplier without taps", "or not (channel.taps or grounded):", "or False:"),
        (
            "channels of the combination",
            "if own.keys() != sum_.clamps.keys() or names != seen:",
            "if len(own) > 9:",
        ),
        ("a constant of the dampers", "(channel.taps or not channel.constant ", "(channel.taps "),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k may_have_no_damping",
        ("a device without damping", "if not min([region.damping[0],", "if not min([1.0,"),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k 'false_multiplier or largest_sets'",
        ("gain of a multiplier against the margin", "if not gain >= margin.gain or", "if"),
        ("extra delay of a multiplier", " or extra != margin.extra_delay_samples:", ":"),
        (
            "combinations that are part of no other",
            "if not any(each < other for other in combinations)]",
            "if each == combinations[0]]",
        ),
        (
            "a held multiplier without a hand",
            "if (multiplier is None) == bool(own):",
            "if multiplier is None and own:",
        ),
        ("dampers that are switched", "=replace(dampers[0], damping=total) if dampers else ", "="),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k largest_sets",
        (
            "a multiplier of each set",
            "if witness is None:\n        raise",
            "if not witnesses:\n        raise",
        ),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k mass_beside",
        ("what fades without a spring", "- clamps.keys()", "- played.keys()"),
    ),
    *_of(
        "tune/certificate/absolute.py",
        f"{_EDGES} -k level_of_what_fades",
        ("levels of elements that fade beside others", "if not proof.proved:", "if proof is None:"),
        ("none and all of a level", ".combinations(fading, count)", ".combinations(fading, 0)"),
    ),
    *_of(
        "tune/certificate/absolute.py",
        "tests/test_shared_proofs.py -k 'covered_by_no_other'",
        ("multipliers of what others cover", "((signal, there, multipliers))", "((signal, there))"),
        ("signals of what others cover", "((signal, there, multipliers)", "((there, multipliers)"),
        ("what fades in sums that others cover", "for setting in sum_.steady", "for setting in ()"),
        ("all parts of sums that others cover", "return all(mine >= its", "return any(mine >= its"),
        ("gains stated of sums that others cover", ")), size * witness.gain", ")), size"),
    ),
    *_of(
        "tune/certificate/certify.py",
        "tests/test_shared_proofs.py -k 'covers_it'",
        ("later claims of what is covered", " or claim.extra > known.extra_delay_samples", ""),
        ("gains claimed of what is covered", "return claim.gain > known.gain or", "return"),
    ),
    # What `certify` asks for.
    *_of(
        "tune/certificate/certify.py",
        f"{_EDGES} -k 'springs_alone or lesser_spring'",
        ("gains of settings on a ray", ".tolist()), abs(size)", ".tolist()), 1.0"),
        ("claims that no other covers", " -late > longest.get(ray, -1.0):", " ray not in longest:"),
    ),
    *_of(
        "tune/certificate/certify.py",
        f"{_EDGES} -k 'ripple or force or passivity or of_a or wall_alone or delay or own_force'",
        ("ripple", "if not meets_wall(design, combination):", "if not combination:"),
        ("forces", "failures += force_failures(design, combination)", "pass"),
        (
            "passivity",
            "failures += passivity_failures(design, combination, setting, regions[0])",
            "pass",
        ),
        ("what is felt", "failures += rendering_failures(design, combination[0], setting)", "pass"),
        ("clamps that may be reached", "if combination in outermost:", "if not combination:"),
        ("delays that are judged", "if longest > _LONGEST_DELAY:", "if longest > 1e9:"),
        (
            "a device that is pushed away",
            "    refuse_unbalanced(design.device, held=design.hand is not None)\n",
            "",
        ),
    ),
    *_of(
        "tune/certificate/certify.py",
        f"{_EDGES} -k level_of_what_fades",
        (
            "a level that is not proved",
            "            failures += error.failures\n            spent |= error.spent\n"
            "            continue\n",
            "            pass\n",
        ),
    ),
    *_of(
        "tune/certificate/claims.py",
        f"{_EDGES} -k 'force or ripple or passivity'",
        ("force levels that sum to the peak", 'cut", levels, limit.peak', 'cut", 0.0, limit.peak'),
        ("sustained force", '("sustained", sustained, limit.continuous', '("sustained", 0.0, 1.0'),
        ("the force of a mass", "+ abs(item.mass) * item.motion.acceleration", "+ 0.0"),
        (
            "a claimed ripple",
            "if len(combination) == 1 and claimed < seen * (1 - _AGREE):",
            "if claimed < 0:",
        ),
        ("passivity of the least damping", " = region.damping[0]\n", " = region.damping[1]\n"),
    ),
    *_of(
        "tune/certificate/certify.py",
        f"{_EDGES} -k claimed",
        ("a claimed gain", "    if gain > margin.gain:\n", "    if gain > 1e9:\n"),
        ("a claimed delay", "    if extra > margin.extra_delay_samples:", "    if extra > 1e9:"),
    ),
    *_of(
        "tune/certificate/certify.py",
        f"{_EDGES} -k not_proved",
        ("a proof that was not found", "        if proof.proved:\n ", "        if proof.cells:\n "),
    ),
    *_of(
        "tune/certificate/poles.py",
        f"{_EDGES} -k 'below_the_whole or box'",
        ("gains below the whole", "if not (crossing <= 0 or crossing > gain):", "if not gain:"),
    ),
    *_of(
        "tune/certificate/region.py",
        f"{_EDGES} -k box",
        ("friction that holds a device", "held.low, high + held.high", "held.low, high + held.low"),
        ("hands", "return (*alone, *(replace(each, hand=hand) for each in alone))", "return alone"),
        ("the largest lag", "else (lag.low, lag.high)", "else (lag.low, lag.low)"),
    ),
    *_of(
        "identification/device/device.py",
        f"{_EDGES} -k box",
        ("intervals that hold at once", " widening(count, freedom, confidence)", " 1.0"),
    ),
    *_of(
        "tune/documents/scene.py",
        f"{_EDGES} -k largest_sets",
        ("a wall is met beside all", " in others for wall in facing", " in others for wall in []"),
    ),
    *_of(
        "tune/certificate/claims.py",
        f"{_EDGES} -k 'of_a_ or felt or beyond or within_a_factor'",
        ("felt within a step", "np.abs(steps) - 1, -1.0)", "np.abs(steps) - 2, -1.0)"),
        ("felt at the fastest", "slow = hertz <= _FASTEST", "slow = hertz <= 0.9 * _FASTEST"),
        ("felt at the slowest", "slow = hertz <= _FASTEST", "slow = np.abs(hertz - 3) < 2.2"),
        ("felt as a mass", "1 / _ALIKE - share)", "0.5 - share)"),
        ("felt as a mass beyond", "np.maximum(share - 2, -share)", "share - 2"),
        ("no damping taken away beyond", "-own - values, ", "-2 * own - values, "),
        ("parasitic damping beyond", "own + asked[effect]) - 1\n", "own + asked[effect]) - 2\n"),
        ("a force that is just noticed", "np.where(part <= 1, part,", "np.where(part < 0, part,"),
        ("numbers of what is felt", "if not abs(seen - said) <= _AGREE * size", "if not size >= 0"),
    ),
    # What `check` compares.
    *_of(
        "tune/certificate/time_domain.py",
        f"{_EDGES} -k told",
        ("damping that is less than the lag takes", "if least < -_AGREE * B:", "if least < -9e9:"),
        ("what is met before a face", "if lead > most * (1 + _AGREE):", "if lead > 9e9:"),
        (
            "the first force",
            "speed * (K * region.sample_time[1] if K else abs(B))",
            "said.force_on_entry",
        ),
        ("bounces", " = _restitution(design, name, element, region)", " = said.restitution"),
        ("net damping with the latest delay", "design.margin.extra_delay_samples + 0.5", "0.5"),
        ("jitter that is less", "if said > 0 and not shrinks", "if said < 0 and not shrinks"),
        ("jitter that is more", "elif said < _MOST and shrinks", "elif said < 0 and shrinks"),
    ),
    *_of(
        "tune/certificate/time_domain.py",
        "tests/test_degenerate.py -k all_one",
        ("jitter of poles that are all one", "_ALIKE = 2.5e-3", "_ALIKE = 0.0"),
    ),
    *_of(
        "tune/certificate/claims.py",
        "tests/test_degenerate.py -k hardly",
        ("a narrow peak of ripple", "np.nan, _panels(denominator)", "np.nan, np.r_[0, np.pi]"),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_audit.py -k nobody",
        ("a level without a limit", "peak = LARGEST if", "peak = np.inf if"),
    ),
    *_of(
        "identification/findings/columns.py",
        "tests/test_findings.py -k held_as_long",
        ("plateaus of either side", "np.sign(force), 0.0)", "1.0, 0.0)"),
    ),
    *_of(
        "identification/readers/__init__.py",
        "tests/test_logs.py -k twice",
        ("rows written twice", "if not again.any() or", "if True or"),
        ("a clock that stays wrong", 'np.diff(found["time"][~again]) > 0', "again >= 0"),
    ),
    *_of(
        "tune/verification/measured_law.py",
        "tests/test_verify.py",
        (
            "a window run instead of a filter",
            "yield _other_window(log, loop, combinations, run)",
            "pass",
        ),
    ),
    *_of(
        "tune/verification/law.py",
        "tests/test_beside_a_wall.py",
        ("others alone outside of a wall", "rest + pushes * mine", "rest + mine"),
        ("a wall that yields", "(beyond < self.level)", "(beyond < np.inf)"),
    ),
    *_of(
        "tune/verification/__init__.py",
        "tests/test_beside_a_wall.py",
        ("motion within a wall beside others", "law.acting,", "law.log.used,"),
    ),
    *_of(
        "tune/verification/measured_law.py",
        "tests/test_fading_logs.py",
        ("rows of a fade", "argmax(size > 0) + rows", "argmax(size > 0)"),
        ("rows of a fade after a pause", ": end + rows] = False", ": end] = False"),
        ("a wrong law after a fade", "or (later.effects and not seen.effects)", ""),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_audit.py -k its_own_level",
        ("the level of the element", ".force_level or level)", ".margins.gain * level)"),
    ),
    *_of(
        "tune/optimisation/cutoffs.py",
        "tests/test_wishes.py -k no_filter_keeps",
        ("what no filter keeps does not count", "return left_out & found", "return left_out"),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_wishes.py -k beside_what_is_played",
        ("what is played beside it", " | dict(played)", ""),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_wishes.py -k helps_is_told_once",
        ("a remedy told twice", '". " not in why and', ""),
        ("less of too little", "* (TOO_LITTLE not in why)", ""),
        ("at most of what is negative", "if sign > 0 else f", "if sign else f"),
        ("more damping where there is some", "if damping is None else", "if True else"),
    ),
    *_of(
        "tune/optimisation/feasibility.py",
        "tests/test_wishes.py -k one_of_the_scene",
        ("the margin of the scene", "asked = gain / (", "asked = gain / 1.0 or ("),
    ),
    *_of(
        "tune/cli/session.py",
        "tests/test_cli_exits.py -k standard",
        ("a file named -", 'if str(output) == "-":', 'if str(output) == "--":'),
    ),
    *_of(
        "identification/documents.py",
        "tests/test_cli_exits.py -k smaller",
        ("too large a file", '_UnsafeError(seen, "Give a smaller file")', "_UnsafeError(seen)"),
    ),
    *_of(
        "tune/optimisation/problem.py",
        "tests/test_wishes.py -k its_fade",
        ("what is left out pumps no more", 'if f"{element}.{effect}" not in left', "if self"),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_wishes.py -k its_fade",
        ("halves of what is pumped", "(size / 2**count for", "(size / 1.01**count for"),
        ("a spring that an element has", 'ways *= "stiffness" in wishes', "ways *= 1"),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_wishes.py -k pumped",
        ("no fade is slow enough", "if least > LONGEST_FADE:", "if least < 0:"),
    ),
    *_of(
        "tune/rendering.py",
        "tests/test_rendering.py -k shakes",
        ("what is felt of a window", "-turn * (window * sample_time)", "-turn * sample_time"),
        ("what is felt of a current lag", "(1 + turn * current_lag)", "(1 - turn * current_lag)"),
    ),
    *_of(
        "identification/estimators/innovations.py",
        "tests/test_auto.py tests/test_choice.py -k 'settle or gets_its_method'",
        ("what presses against its bound", "_NOISE = (1, 2)", "_NOISE = (0, 1, 2, 3)"),
    ),
    *_of(
        "tune/certificate/check.py",
        f"{_EDGES} -k told",
        ("an absolute gain that is not proved", "if said != seen:", "if said == -1.0:"),
        ("sets that are proved", "if combination not in stated.interior:", "if not combination:"),
        ("sets that there are not", "if combination not in fresh.interior:", "if not combination:"),
        ("where the worst point is", "       return region", "       pass\n        return region"),
        (
            "how bad the worst point is",
            "if not np.isclose(seen, stated.pole_radius, rtol=_AGREE, atol=0):",
            "if seen < 0:",
        ),
        (
            "numbers of the certificate",
            "if len(seen) != len(said) or not np.allclose(seen, said, rtol=_AGREE, atol=0):",
            "if name is None:",
        ),
        (
            "a gain above the absolute one",
            "if said.absolute_gain is not None and said.gain > said.absolute_gain:",
            "if said.gain < 0:",
        ),
        ("ripple of an element", " = abs(said - seen) <= _RIPPLE_AGREES * seen", " = seen >= 0"),
    ),
    *_of(
        "tune/certificate/check.py",
        f"{_EDGES} -k false_word_is",
        ("a worse point than is stated", "elif 1 - seen > (1 + _SEARCH) ", "elif 1 - seen > 9e9 "),
    ),
    *_of(
        "tune/certificate/check.py",
        f"{_EDGES} -k every_false_word",
        ("a limit that does not bind", " not believed and getattr(element, effect):", " not word:"),
        ("notes beyond what was wanted", " len(design.notes) != len(", " len(design.notes) < len("),
    ),
    *_of(
        "tune/certificate/check.py",
        "tests/test_rehearse.py -k less_is_asked",
        (
            "a limit by stability that no rehearsal took",
            "{label for label in labels if note_of_rehearsal(label) in design.notes}",
            "labels if design.notes is not None else set()",
        ),
    ),
    *_of(
        "tune/optimisation/solve.py",
        "tests/test_wishes.py -k range",
        ("all of an element goes", "dict.fromkeys(mates, f", "dict.fromkeys((), f"),
    ),
    *_of(
        "tune/optimisation/limits.py",
        "tests/test_felt_band.py -k late_spring",
        ("damping that a spring takes away", "= -given / ((1 -", "= -given[~IN_MOTION] / ((1 -"),
    ),
    *_of(
        "tune/optimisation/cutoffs.py",
        "tests/test_cutoffs.py -k is_dropped",
        ("a stated filter of what is dropped", "if mine.used and not", "if mine.free and not"),
    ),
    *_of(
        "tune/optimisation/limits.py",
        "tests/test_wishes.py -k taken_away",
        ("a wanted value that a device cannot lose", " or self.high < abs(self.wish.high)", ""),
    ),
    *_of(
        "tune/optimisation/feasibility.py",
        "tests/test_wishes.py -k how_much_one_is",
        ("much too little is wanted", "(top == unknown.high or _NOTHING", "(_NOTHING"),
        ("a step rounded up", "floor(step / digit + 1)", "floor(step / digit - 1)"),
    ),
    *_of(
        "tune/optimisation/describe.py",
        "tests/test_wishes.py",
        ("a wanted value is met", "abs(size) >= _MET *", "abs(size) >= 1e-9 *"),
        ("felt as something else", "if most > 1 else", "if most > 99 else"),
    ),
    *_of(
        "tune/documents/profile.py",
        f"{_EDGES} -k every_false_word",
        ("a profile of another law", "    if law != LAW and str", "    if not content and str"),
    ),
    *_of(
        "tune/documents/profile.py",
        f"{_EDGES} -k after_it_was_signed",
        ("the digest", "if stated != expected:", 'if stated == "":'),
    ),
    *_of(
        "tune/documents/profile.py",
        "tests/test_export.py -k signed_anew",
        ("a profile signed anew as it is written", '(self), f"the', '(self.signed()), f"the'),
    ),
    *_of(
        "tune/exporters/__init__.py",
        "tests/test_export.py -k signed_anew",
        ("the digest of an export", "signed_content(to_mapping(profile), f", "str(f"),
    ),
    *_of(
        "identification/documents.py",
        "tests/test_export.py -k signed_anew",
        ("a mapping that is changed", " type(value) is dict else value", " raw is cls else value"),
    ),
    # Limits of the tuner.
    *_of(
        "tune/optimisation/feasibility.py",
        f"{_EDGES} -k tuner",
        ("ripple of one effect", "limit=limits.ripple,", "limit=2 * limits.ripple,"),
        (
            "force and lead",
            "return min(problem.linear.bounds(sizes, index).values(), default=np.inf)",
            "return np.inf",
        ),
        ("the margin of one effect", "unknown.sign, late=late) / gain", "unknown.sign, late=late)"),
    ),
    *_of(
        "tune/optimisation/feasibility.py",
        "tests/test_optimise.py -k two_effects",
        (
            "ripple of several",
            "return last_within(noise, problem.limits.ripple, top, float(sizes[index]))",
            "return np.inf",
        ),
    ),
    *_of(
        "tune/certificate/poles.py",
        "tests/test_optimise.py -k threads",
        ("balls of one thread at a time", "with _ALONE:", "if _ALONE:"),
    ),
    # Sampled motion, estimates, intervals and what is believed.
    *_of(
        "tune/loop/loop.py",
        "tests/test_loop.py -k unlike_shapes",
        ("effects of unlike shapes", "spread(added, total.shape[1:])", "added"),
    ),
    *_of(
        "tune/loop/plant.py",
        "tests/test_loop.py -k far_from",
        ("far poles that are real", "fast - slow if mirrored else slow - fast", "slow - fast"),
        (
            "far poles in pairs",
            "np.where(stiff, step(low + span) - step(low), between / apart)",
            "between / apart",
        ),
    ),
    *_of(
        "identification/estimators/estimate.py",
        "tests/test_methods.py -k covariance",
        ("intervals", "(shifts.T @ shifts + floor)", "(0.25 * shifts.T @ shifts + floor)"),
        (
            "intervals with instruments",
            "_halfway(inverse, normal, right)",
            'np.einsum("ijk,ik->ij", np.linalg.pinv(total - normal), right)',
        ),
    ),
    *_of(
        "identification/estimators/estimate.py",
        "tests/test_choice.py",
        ("an estimate that another contradicts", "CONTRADICTED = 11.83", "CONTRADICTED = 1e9"),
    ),
    *_of(
        "identification/fitting/__init__.py",
        "tests/test_choice.py",
        ("residuals that are white", "if not is_coloured(residual):", "if True:"),
        ("an estimate that knows less", " found and region(predicted) <= region(default)", " True"),
    ),
    *_of(
        "identification/fitting/__init__.py",
        "tests/test_findings.py -k 'measured or rows_late'",
        ("an early force that tells a delay", "deviation=most / np.sqrt(12))", "deviation=0.0)"),
        ("a measured force that is held", "if early is not None and", "if False and"),
        ("rows of force logged late", "() if early is None else (rows", "() if True else (rows"),
    ),
    *_of(
        "identification/findings/forces.py",
        "tests/test_choice.py -k evidence",
        (
            "a mass that equal velocities exclude",
            "if judge is None or not judge.contradicts(chosen):",
            "if True:",
        ),
    ),
    *_of(
        "identification/findings/__init__.py",
        "tests/test_choice.py -k evidence",
        ("delays that exclude each other", "if chosen.delay_deviation is None:", "if True:"),
    ),
    # The guard in C.
    *_of(
        "tune/templates/guard.c",
        _GUARD,
        ("a wall that pulls", " && contact->side < 0 ? 0.0 :", " && contact->side < 0 ? -9e9 :"),
        ("the level of a clamp", "return u < low ? low : u > high ? high : u;", "return u;"),
        ("a gain that rises under force", "|| contact->quiet >= HAPTUNE_TAPS) {", "|| 1) {"),
        (
            "a gain that rises too soon",
            "contact->quiet = counted(contact->quiet, u == 0.0);",
            "contact->quiet += u == 0.0 ? 2 : 0;",
        ),
        ("a spring entered away from its rest", "if (enters && spring) {", "if (0 && spring) {"),
        ("a filter that comes to rest", "#define VANISHED 1e-30", "#define VANISHED 0.0"),
        ("a rest that moves under force", "[index].force != 0.0) {", "[index].force > 9e9) {"),
        (
            "sets that are certified",
            "return elements == 0 || (low < COMBINATIONS && combinations[low] == elements);",
            "return 1;",
        ),
        (
            "what still fades out counts",
            "if (together(guard, elements | fading) != HAPTUNE_OK) {\n        elements",
            "if (0) {\n        elements",
        ),
        ("a corridor that is too narrow", "return !(room >= lead);", "return 0;"),
        ("fades while a wall pushes", "pushing ? 0.0 : played[index].fade ", "played[index].fade "),
        ("a face that moves at once", "contact->clear >= HAPTUNE_TAPS) ", "contact->clear >= 1) "),
    ),
    *_of(
        "tune/templates/guard.c",
        "tests/test_guard_faults.py",
        ("a gain above 1", "gain < 0.0 || gain > 1.0", "gain < 0.0"),
        ("missed periods in a row", " if (steps - 1 > HAPTUNE_EXTRA_DELAY)", " if (steps > 999u)"),
        ("readings that cannot be", "} else if (!plausible(axis, steps, position)", "} else if (0"),
        ("a reading used twice", "} else if (steps == 0) {", "} else if (0) {"),
        ("the line of one period earlier", " - line) <= most || ", " - line) <= most && "),
        ("contacts after a gap", "        end_contacts(guard, UINT64_MAX);\n        ", "        "),
        ("a test that flags take out", "if (!usable(position)) {", "if (position != position) {"),
        ("a gain of NaN", "!usable(gain) || ", ""),
        ("a face of NaN", "} else if (!usable(rest)) {", "} else if (rest != rest) {"),
    ),
    *_of(
        "tune/templates/guard.c",
        "tests/test_guard.py",
        ("the peak force", "    if (force > peak_force) {", "    if (force > 9e9) {"),
        ("a fade", "->level = faded(contact->level, asked, change);", "->level = asked;"),
    ),
    *_of(
        "tune/templates/guard.h",
        "tests/test_guard_faults.py tests/test_mixed_exports.py -k 'fault or compile or link'",
        ("flags that are refused", "(defined(__FINITE_MATH_ONLY__) && __FINITE", "(0 && __FINITE"),
        ("two headers in one source", "#if defined(HAPTUNE_PROFILE) && ", "#if 0 && "),
    ),
    *_of(
        "tune/exporters/__init__.py",
        "tests/test_mixed_exports.py -k link",
        ("names with the digest", '{"word": word,', '{"word": "",'),
    ),
    *_of(
        "tune/templates/chai3d.hpp",
        "tests/test_mixed_exports.py -k 'compile or program'",
        ("a guard of another profile", "#if HAPTUNE_PROFILE != ${tag}", "#if 0"),
        ("axes of two profiles", "inline namespace profile_${word} ", "inline namespace profile "),
    ),
    # The node of ROS 2, and what is exported together.
    *_of(
        "tune/templates/node.py",
        "tests/test_ros2.py",
        ("messages that stop", "(self.law.extra_delay + 1.5) * self", "9 * self"),
        ("the way of the message after lost ones", "extra_delay + 1.5)", "extra_delay + 1)"),
        ("messages that come late", "        if self.overdue(stamp):", "        if False:"),
        ("a clock that jumps", "or self.law.status is Status.LATE:  #", "or False:  #"),
        ("clocks that run apart", "_DRIFT * self.step, took)", "0.0, took)"),
        ("a message of another joint", "        if lacking:", "        if not names:"),
        ("a reading of no use", "if not self.law.waiting:", "if True:"),
        ("a law of another profile", 'if PROFILE != "${digest}":', "if False:"),
    ),
    *_of(
        "tune/templates/law.py",
        "tests/test_ros2.py",
        ("a force held after a silence", "return self._no_force(Status.LATE)", "return 0.0"),
        ("parameters of another profile", "if told != PROFILE:", "if False:"),
    ),
    *_of(
        "tune/templates/law.py",
        _GUARD,
        ("a filter that comes to rest, in Python", "_VANISHED = 1e-30", "_VANISHED = 0.0"),
    ),
    *_of(
        "identification/documents.py",
        "tests/test_mixed_exports.py",
        ("a kill between two files", "if len(moves) > 1 and sys.executable:", "if False:"),
        ("all files or none", "_take_back(target, replaced.get(moved))", "pass"),
    ),
    # Several axes.
    *_of(
        "tune/templates/axes.c",
        "tests/test_several_axes.py -k 'guard or face or cut or fades or line or laws or room'",
        ("the length of a spring's force", " (!(length > most * SHORTER))", " (length == length)"),
        ("a rounding above the peak", "(1.0 - 8.0 * DBL_EPSILON)", "1.0"),
        ("the peak of all axes", "    shortened(sum, peak_force);", ""),
        ("two laws at an angle", "} else if (turned > ROUNDING - 1.0) {", "} else if (0) {"),
        ("a room without a place", "&& !project(", "&& 0 && !project("),
        ("a face left for another", "pushes[held[place]] < step * parts[place]", "0"),
        ("a face that comes while its wall pushes", "if (pushing && product(", "if (0 && product("),
        ("a face in its place again", "face->clear >= HAPTUNE_TAPS ?", "0 ?"),
        ("a face that pushes and moves", "if (here->pushing) {", "if (0) {"),
        (
            "fades of all axes while a face pushes",
            "pushing |= wall && device->elements[place].contact.force != 0.0;",
            "",
        ),
        ("a glitch of one axis", "&& !plausible(&axes[axis], steps, position[axis])", "&& 0"),
        ("a wall that is apart from a fluid", "        if (!certified(ahead)) ", "        if (0) "),
    ),
    *_of(
        "tune/templates/axes.py",
        "tests/test_several_axes.py -k 'guard or angle'",
        ("two laws of axes at an angle", "elif turned > _ROUNDING - 1.0:", "elif False:"),
        ("a room of axes without a place", "if own[0] is here and", "if own[0] is None and"),
    ),
    *_of(
        "identification/device/device.py",
        "tests/test_several_axes.py",
        (
            "masses of all directions in the box",
            '            masses = self._over_directions("mass", each)\n',
            "",
        ),
        (
            "dampings of all directions in the box",
            '            ranges = [self._over_directions("damping", each)]\n',
            "",
        ),
    ),
    *_of(
        "identification/device/quantities.py",
        "tests/test_several_axes.py",
        ("the sides of what is known of a direction", " = side * deviations", " = -deviations"),
    ),
    *_of(
        "identification/fitting/several_axes.py",
        "tests/test_several_axes.py",
        ("axes that are not told apart", "if joint.apart < _ALIKE:", "if joint.apart < 0:"),
        ("an axis with the other sign", "except NoMassError:", "except ZeroDivisionError:"),
        (
            "a spring on one of several axes",
            "if moved or any(each.code",
            "if not known and any(each.code",
        ),
        ("friction along no axis", "if heavy and not explained else None", "if False else None"),
        ("friction too strong to be taken out", "if doubt[axis] > most", "if doubt[axis] < 0"),
    ),
    *_of(
        "identification/estimators/turned_friction.py",
        "tests/test_several_axes.py -k 'joints or no_encoder'",
        ("friction that nothing tells", "if value <= _CLEAR * deviation:", "if False:"),
        (
            "friction that moves little",
            "if harmless or rest.size > _MUCH_LEFT * first.size:",
            "if False:",
        ),
    ),
    *_of(
        "identification/estimators/reciprocity.py",
        "tests/test_units_of_axes.py",
        ("rows of two axes that contradict each other", "<= least:", ">= 0:"),
        ("a gain of mass and damping", "forth / back, forth / back) < nearly / 2", "1, 1) > 0"),
    ),
    *_of(
        "identification/readers/columns.py",
        "tests/test_units_of_axes.py",
        ("a gain of one axis alone", '"," * place, ","', '"", ","'),
        ("as many gains as axes", "if len(gains[role]) != count:", "if len(gains[role]) > 99:"),
    ),
    *_of(
        "tune/cli/logs.py",
        "tests/test_asking.py -k one_axis",
        ("an answer for one of several axes", "parts[error.place or 0]", "parts[0]"),
    ),
    *_of(
        "tune/optimisation/problem.py",
        "tests/test_clamps.py -k without_effects",
        ("what gives no force is apart from nothing", "if {*pair} <= {*there})", "if pair)"),
    ),
    *_of(
        "identification/readers/columns.py",
        "tests/test_units_of_axes.py -k fit_no_axes",
        ("a column for one axis", "parts[role].count(each) > 1", "parts[role].count(each) > 9"),
    ),
    *_of(
        "tune/cli/judging.py",
        "tests/test_several_axes.py -k does_not_tell",
        ("the direction to play along", "{begin}{along(safe, direction)}", "{begin}"),
    ),
    *_of(
        "identification/planning/several_axes.py",
        "tests/test_excitation_of_axes.py -k any_direction",
        ("light in one direction of many", "_turned(Region.stated(", "_devices(Region.stated("),
    ),
    *_of(
        "tune/cli/session.py",
        "tests/test_units_of_axes.py -k names_the",
        ("the log that a refusal is of", 'source.count(", ") + 1 < self.logs', "False"),
    ),
    *_of(
        "identification/fitting/several_axes.py",
        "tests/test_units_of_axes.py -k names_the",
        ("the axis that a refusal is of", ' f"{log.source}, axis {log.axis}"', " log.source"),
    ),
    *_of(
        "identification/_identify.py",
        "tests/test_units_of_axes.py -k column",
        (
            "one column of several axes",
            "if hardware.axes is not None and not several:",
            "if hardware.axes is None and several and not known:",
        ),
    ),
    *_of(
        "tune/documents/changes.py",
        "tests/test_comparing_axes.py",
        ("entries of several axes", " old.axes is not None and new.axes", " False and new.axes"),
    ),
    *_of(
        "identification/device/device.py",
        "tests/test_comparing_axes.py",
        ("axes by name", " = sorted((axes[row], axes[column]))", " = axes[row], axes[column]"),
    ),
    *_of(
        "tune/optimisation/problem.py",
        "tests/test_optimise.py -k proved",
        ("an element that is not proved", "if not go or scene.elements.keys() <= gone", "if True"),
        ("a wall that is told apart", "return self.without(pair)", "pass"),
    ),
    *_of(
        "tune/stability/nonlinear.py",
        "tests/test_optimise.py -k taken",
        (
            "the pole of a place that nothing binds",
            "still, more = _without_place(still, more)",
            "pass",
        ),
    ),
    *_of(
        "identification/estimators/joint_motion.py",
        "tests/test_several_axes.py",
        ("what holds an axis beside others", "np.flatnonzero(excess", "np.flatnonzero(0 * excess"),
    ),
    *_of(
        "tune/certificate/certify.py",
        "tests/test_several_axes.py",
        ("a hand on several axes", "if held and device.axes is not None:", "if False:"),
    ),
    # Several axes: what drives them one after another, and what is felt across a force.
    *_of(
        "identification/estimators/joint.py",
        "tests/test_several_axes.py -k 'one_after or leave_an'",
        ("axes that stand are held", "<= _NOISE * table.signals.noise", "< 0"),
        ("axes that never move together", "if all(part.stands[one] or part.", "if any(part."),
    ),
    *_of(
        "identification/fitting/several_axes.py",
        "tests/test_several_axes.py -k 'one_after or leave_an'",
        ("axes that no force drives", "        if seen.all():\n", "        if seen.any():\n"),
    ),
    *_of(
        "datasets_synthetic/simulation.py",
        "tests/test_rig.py -k frees",
        ("an axis freed within a sample", "] - pull) > friction[which]", "] - pull) > np.inf"),
    ),
    *_of(
        "tune/verification/directions.py",
        "tests/test_several_axes.py -k 'gain_of_one or askew'",
        ("force across is judged", "agrees=seen <= allowed", "agrees=True"),
    ),
    *_of(
        "tune/verification/motion.py",
        "tests/test_several_axes.py -k 'let_go or leaves_its or compares'",
        ("motion across is judged", "if bent > _MOST_BENT:", "if bent > np.inf:"),
        ("a play that is not cut", "most = min(levels, default=np.inf)", "most = np.inf"),
    ),
    *_of(
        "tune/verification/motion.py",
        "tests/test_letting_go.py -k a_wall_that",
        (
            "a wall is not let go of for its motion",
            "elif profile.walls.intersection(combination):",
            "elif False:",
        ),
    ),
    *_of(
        "tune/verification/motion.py",
        "tests/test_letting_go.py",
        ("friction stops what is pushed", "device.coulomb_friction.high / (moved * decay)", "0.0"),
        (
            "speed that does not fall",
            "begin is None or speed[max(begin, end - width)] > _FALLEN * speed[begin]",
            "begin is None",
        ),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_audit.py -k outlives_the_next",
        ("a device that changed is not at its margin", "nearly = unchanged and", "nearly ="),
        ("no more than a hundredth is lost", "error.failures, (1 - _STEP)", "error.failures, 0.5"),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_audit.py -k friction_is_felt",
        ("friction is felt", "steps=_signed_steps(scale, after - before)", "steps=0.0"),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_cli_exits.py -k 'take and away'",
        ("no delay of the device is taken away", " >= 0:", " >= -1:"),
    ),
    *_of(
        "tune/exporters/__init__.py",
        "tests/test_ros2.py -k no_node_can_have",
        ("no lines in the name of a node", "    refuse_strange_node(node)\n", ""),
    ),
    *_of(
        "tune/rendering.py",
        "tests/test_haptune.py -k no_call_can",
        ("no encoder whose count is below zero", "if not 0 < number < math.inf", "if number == 0"),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_audit.py -k met_farther",
        ("gains like a wall keep its lead", ".lead > lead * (1 + _ROUNDED)", ".lead > np.inf"),
    ),
    *_of(
        "tune/verification/free_motion.py",
        "tests/test_letting_go.py",
        ("motion is free where the hand lets go", " > max(_MORE * usual, small):", " > np.inf:"),
    ),
    *_of(
        "identification/estimators/least_squares.py",
        "tests/test_identify.py -k many_fast_samples",
        ("a delay beside the scan's steps", "for _ in range(_MOST_MOVES):", "for _ in range(1):"),
    ),
    *_of(
        "identification/trajectory.py",
        "tests/test_long_logs.py -k where_the_device_is_driven",
        ("a part that is driven", "first = int(starts[best if", "first = int(starts[0 if"),
    ),
    *_of(
        "identification/findings/lost_rows.py",
        "tests/test_findings.py -k too_fast",
        ("a jump that a narrow cubic leaves", "if not _jumps(traj", "if 0 and _jumps(traj"),
        ("a step longer than a cubic", "< _JUMPS * long.size:", "< -np.inf:"),
    ),
    *_of(
        "identification/findings/lost_rows.py",
        "tests/test_findings.py -k 'twice'",
        ("time that a repeated row did not take", "np.where(again, 0.0, ", "np.where(again, 1.0, "),
        ("rows at another rate", "if regular or share", "if share"),
    ),
    *_of(
        "identification/findings/force_balance.py",
        "tests/test_findings.py -k holds_at_rest",
        ("what friction holds at rest", "self.direction)) * standing", "self.direction)) * 0"),
    ),
    *_of(
        "identification/fitting/dynamics.py",
        "tests/test_dynamics.py -k mains",
        ("a mode whose damping is told", "if ringing or NORMAL_95**2", "if 0 * NORMAL_95**2"),
    ),
    *_of(
        "identification/fitting/dynamics.py",
        "tests/test_dynamics.py -k depends_on_position",
        ("the speed that turns with a mass by position", "np.gradient(smooth) / 2", "0 * smooth"),
    ),
    *_of(
        "identification/device/hardware.py",
        "tests/test_dynamics.py -k stated_mode",
        ("a mode of the log beside those stated", "held.append(seen)", "pass"),
        ("the larger share of a mode", "if seen.at_encoder > abs", "if 0 > abs"),
    ),
    *_of(
        "identification/fitting/stated_lag.py",
        "tests/test_dynamics.py -k stated_lag",
        ("the force behind a stated lag", "replace(trajectory, force=force)", "trajectory"),
        ("a delay as doubtful as the lag", '{"delay": doubtful}', '{"delay": delay}'),
        ("a stated lag against the log", "if apart <= WRONG_DELAY", "if 1 or apart <= WRONG_DELAY"),
    ),
    *_of(
        "identification/device/quantities.py",
        "tests/test_dynamics.py -k stated_lag",
        ("a lag of the log beside the one stated", '{"low": low, "high": high})', '{"low": low})'),
    ),
    *_of(
        "identification/fitting/dynamics.py",
        "tests/test_dynamics.py -k behind_a_spring",
        ("an encoder that a spring parts from the drive", ' or told.needed != ""', ""),
        ("friction that passes the spring", "driven(against))\n", "driven(0 * against))\n"),
    ),
    # Elements that are alike: one stands for all.
    *_of(
        "tune/documents/scene.py",
        "tests/test_alike.py",
        ("alike in all they say", "if elements[each] == elements[name])", "if True)"),
        ("apart from the same", "if others[each] == others[name])", "if True)"),
    ),
    *_of(
        "tune/optimisation/alike.py",
        "tests/test_alike.py -k told",
        (
            "pairs of all that are alike",
            "for alike in pairs.values() for each in alike",
            "for each in pairs",
        ),
        ("notes of all that are alike", "for each in members[name])", "for each in [name])"),
    ),
    *_of(
        "tune/certificate/check.py",
        "tests/test_edges.py -k false_word",
        ("room beside a wall", "_ROOM if gives_room else _GROWN, [name], ", "_ROOM, [name], "),
    ),
    *_of(
        "tune/templates/player.py",
        "tests/test_player.py -k whatever_stops",
        ("travel of every axis", ", place in enumerate(places))", ", place in [(0, places[0])])"),
    ),
    *_of(
        "tune/templates/player.py",
        "tests/test_player.py -k 'terminal'",
        ("a terminal that goes", '"SIGHUP", ', ""),
    ),
    *_of(
        "tune/templates/player.py",
        "tests/test_player.py -k 'program_itself'",
        ("limits of a play", "if not 0 <= limit < math.inf or", "if limit < 0 or"),
    ),
    *_of(
        "tune/templates/player.c",
        "tests/test_player.py -k 'program_itself'",
        ("limits of a play, in C", " == argv[word + 1] || *tail ||", " == argv[word + 1] ||"),
    ),
    *_of(
        "tune/templates/player.c",
        "tests/test_player.py -k 'terminal'",
        ("a terminal that goes, in C", "signals[] = { SIGHUP, ", "signals[] = { "),
    ),
    *_of(
        "tune/templates/player.c",
        "tests/test_player.py -k whatever_stops",
        (
            "travel of every axis, in C",
            "most = fmax(most, fabs(positions[axis] - others[axis]));",
            "most = fabs(positions[0] - others[0]);",
        ),
    ),
    *_of(
        "identification/findings/forces.py",
        "tests/test_findings.py tests/test_long_logs.py -k 'less_than_the_log or left_out_is_seen'",
        ("what an actuator gives", ") for part in parts)) > _BENT:", ") for part in parts)) > 0:"),
        (
            "an actuator in both halves",
            "max(share, *(left_by(knee, *part) for part in parts)) > _BENT",
            "share > _BENT",
        ),
        ("a dead zone of an actuator", '", part) if part < 1 else ("below", 1 / part)', '", part)'),
    ),
    *_of(
        "identification/fitting/several_axes.py",
        "tests/test_units_of_axes.py -k one_sample_each",
        ("rows of several axes", "inspect(axis, hardware, alone=False)", "inspect(axis, hardware)"),
    ),
    *_of(
        "tune/cli/preparation.py",
        "tests/test_rehearse.py -k faces_no_other",
        ("walls without a spring face none", "        and element.stiffness  #", "        #"),
    ),
    *_of(
        "tune/judging.py",
        "tests/test_audit.py -k in_its_hand",
        ("the hand of whose profile it is", ', "hand": like[0].hand or "none"', ""),
        ("the margin of whose profile it is", "like[0].margin.name", '"balanced"'),
    ),
    *_of(
        "datasets_synthetic/rehearsal.py",
        "tests/test_bench.py -k what_is_pushed",
        ("what damping is left holds a push", " + np.minimum(damping, 0.0).sum(axis=0)", ""),
    ),
    *_of(
        "datasets_synthetic/rehearsal.py",
        "tests/test_bench.py -k leans_on",
        ("a pull is leaned against", " + np.maximum(rigs.force_offset, 0.0)", ""),
    ),
    *_of(
        "datasets_synthetic/ending.py",
        "tests/test_bench.py -k what_is_pushed",
        ("what is pushed may gain", "np.maximum(travel - allowed.steady, 0.0)", "travel"),
        ("no push excuses what runs away", "pull, moved) if", "pull) if"),
    ),
    *_of(
        "tune/cli/settling.py",
        "tests/test_rehearse.py -k less_is_asked",
        ("less is taken from a device too", 'kind="min" if size < 0 else "range"', 'kind="range"'),
    ),
    *_of(
        "tune/cli/settling.py",
        "tests/test_rehearse.py -k sake",
        ("what is whole again is rehearsed too", "continue", "return profile"),
    ),
    *_of(
        "tune/cli/preparation.py",
        "tests/test_excitation.py -k pull_at_it",
        ("what pulls at a known device", '.startswith("unplanned") or not known', " and not known"),
    ),
)


def copy_tree(folder: Path) -> None:
    """All files that git knows of or would, without its own."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not (ROOT / name).is_symlink():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def run_pytest(
    folder: Path, *given: str, longest: float = _LONGEST
) -> subprocess.CompletedProcess[str]:
    """Tests of a copy, importing what is there; at most so many seconds."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *given],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=longest,
        check=False,
    )


def outcome_of(fault: Fault, folder: Path) -> str:
    """How its tests end in a copy: "caught", "NOT CAUGHT", or why they could not be asked."""
    file = folder / fault.file
    text = file.read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        return f"its text stands {text.count(fault.old)} times"
    file.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    try:
        done = run_pytest(folder, "-n0", "-x", *shlex.split(fault.tests))
    except subprocess.TimeoutExpired:
        return f"not caught within {_LONGEST} s"
    finally:
        file.write_text(text, encoding="utf-8")
    return {0: "NOT CAUGHT", 1: "caught"}.get(done.returncode, done.stdout[-300:])


def are_caught(faults: Sequence[Fault]) -> bool:
    """Whether each is, said of each as soon as it is known."""
    with tempfile.TemporaryDirectory() as name:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(_AT_ONCE):
            copy_tree(Path(name) / str(number))
            copies.put(Path(name) / str(number))
        words = [word for fault in faults for word in shlex.split(fault.tests)]
        files = sorted({word for word in words if word.startswith("tests/")})
        sound = run_pytest(Path(name) / "0", f"-n{_AT_ONCE}", *files, longest=3 * _LONGEST)
        if sound.returncode:
            print(f"tests fail without any fault:\n{sound.stdout[-2000:]}")
            return False

        def tell(fault: Fault) -> bool:
            started, folder = time.monotonic(), copies.get()
            outcome = outcome_of(fault, folder)
            copies.put(folder)
            took = time.monotonic() - started
            print(f"{outcome:10} {took:4.0f} s  {fault.name} ({fault.file})", flush=True)
            return outcome == "caught"

        with ThreadPoolExecutor(_AT_ONCE) as pool:
            caught = list(pool.map(tell, faults))
    print(f"{sum(caught)} of {len(caught)} faults caught")
    return all(caught)


if __name__ == "__main__":
    asked = sys.argv[1:]
    chosen = [each for each in FAULTS if not asked or any(word in each.name for word in asked)]
    raise SystemExit(not are_caught(chosen))
