"""Is it safe, and does it still hold: ``haptune audit``, ``check``, ``compare`` and ``verify``."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Argument, Option

import identification as ident
from identification import UsageError
from tune.cli.logs import tell_reading
from tune.cli.preparation import refuse_restless
from tune.cli.profiles import IN_DEVICE, draw_profile
from tune.cli.session import LogOptions, MarginOption, Picture, Session, command
from tune.documents import CheckFailedError

if TYPE_CHECKING:
    from rich.table import Table

    from identification import Device, Motion
    from tune.documents.estimators import FilterKind
    from tune.documents.profile import SafeProfile
    from tune.judging import Audit, Change, Comparison, Felt, Interval
    from tune.loop.loop import Filters
    from tune.verification import Advice, Kept, Verification

#: Unit of each quantity of a device, by the name it has in a table of units.
_UNITS = {"mass": "mass", "damping": "damping", "damping_slope": "damping",
          "coulomb_friction": "force", "force_offset": "force", "force_limit.continuous": "force",
          "force_limit.peak": "force", "encoder_resolution": "length",
          "position_stiffness": "stiffness", "presliding_stiffness": "stiffness"}  # fmt: skip
#: How a filter is given.
_FILTER = "HZ[,KIND[,ORDER]]"
#: Advice at less than this many times the gain that was played is no other advice.
_MORE = 1.02
#: Cosine of the angle within which two directions are one.
_ALONG = 0.999


@command()
def audit_command(
    session: Session,
    device: Annotated[str, Argument(help="device.yaml, or the name of a known device.")],
    stiffness: Annotated[float, Option(metavar="K", help="N/m (N·m/rad).")] = 0.0,
    damping: Annotated[float, Option(metavar="B", help="N·s/m (N·m·s/rad).")] = 0.0,
    mass: Annotated[float, Option(metavar="M", help="kg (kg·m²).")] = 0.0,
    extra_delay_samples: Annotated[
        float, Option(metavar="X", help="On top of the device's own delay.")
    ] = 0.0,
    velocity_filter: Annotated[
        str | None,
        Option(
            metavar=_FILTER, help="Cut-off; low-pass of 1 or 2 poles, tracking of 2 or 3 states."
        ),
    ] = None,
    acceleration_filter: Annotated[
        str | None,
        Option(
            metavar=_FILTER, help="Cut-off; low-pass of 2 or 1 poles, tracking of 3 or 4 states."
        ),
    ] = None,
    filter_damping_ratio: Annotated[
        float | None, Option(min=0.1, max=1.0, metavar="Z", help="Of pairs of poles; default 1.")
    ] = None,
    margin: MarginOption = None,
    like: Annotated[
        str | None,
        Option(
            metavar="PROFILE,ELEMENT",
            help="Judged as this element is: a wall, in its motion and hand; by its gains, and the "
            "filters and margin of its profile, where none are given.",
        ),
    ] = None,
    picture: Picture = None,
) -> None:
    """Are these gains safe, why not, and the nearest safe ones; exit code 6 if they are not."""
    from tune.certificate.certify import NO_HAND, WITH_HAND, trusted_facts
    from tune.documents.scene import Effects
    from tune.judging import NEEDED, audit
    from tune.loop.loop import Filters, filters_of
    from tune.presentation.tables import audit_table

    wanted = {"stiffness": stiffness, "damping": damping, "mass": mass}
    session.target(picture, Path(device))
    model = _model_of(like)
    if model is not None and not any(wanted.values()):
        wanted = {name: getattr(model[0].elements[model[1]], name) for name in wanted}
    _refuse_nonsense(wanted, extra_delay_samples)
    given = (velocity_filter, acceleration_filter, filter_damping_ratio)
    filters = _filters(*given, Filters() if model is None else filters_of(model[0].loop))
    known = ident.load_device(device)
    known.require_stated(NEEDED, subject=device, where=IN_DEVICE)
    with session.progress("judging the gains"):
        found = audit(
            known,
            Effects(**wanted),
            filters=filters,
            margin=margin,
            extra_delay_samples=extra_delay_samples,
            like=model,
        )
    session.details |= _audit_details(found)
    hand = NO_HAND if found.design.hand is None else WITH_HAND
    session.details["taken_on_trust"] = trusted = *trusted_facts(found.design.device), hand
    wrong = " and ".join(dict.fromkeys(fault.limit for fault in found.faults))
    proved = f"safe with margin {found.design.margin.name}, proved over the whole box"
    verdict = f"NOT SAFE: {wrong}" if wrong else proved
    session.say(verdict)
    session.say(audit_table(found))
    session.say_each(f"taken on trust: {line}" for line in trusted)
    draw_profile(session, picture, found.design, verdict)
    if found.safe:
        return
    faults = [f"{f.limit}: {f.seen}; needed: {f.needed}\n  {f.remedy}" for f in found.faults]
    nearest = " ".join(f"--{name} {value:.6g}" for name, value in _nearest(found).items() if value)
    words = f"nearest safe values: {nearest}" if nearest else "no safe value was found"
    raise CheckFailedError((*faults, words))


def _model_of(like: str | None) -> tuple[SafeProfile, str] | None:
    """The profile and the name of its element that are given as one."""
    from tune.documents.profile import load_profile

    if like is None:
        return None
    path, _, name = like.rpartition(",")
    profile = load_profile(path or like)
    if name not in profile.elements:
        known = ", ".join(profile.elements)
        raise UsageError("--like", f"{name} is no element of it", f"Give PROFILE,ELEMENT: {known}")
    return profile, name


def _refuse_nonsense(wanted: dict[str, float], extra: float) -> None:
    if not any(wanted.values()):
        raise UsageError("--stiffness, --damping, --mass", "all are zero", "Give one of them")
    if wanted["stiffness"] < 0:
        seen = f"{wanted['stiffness']:g} is never stable"
        raise UsageError("--stiffness", seen, "Give zero or more")
    gains = {f"--{name}": value for name, value in wanted.items()}
    for option, value in (gains | {"--extra-delay-samples": extra}).items():
        if not math.isfinite(value):
            raise UsageError(option, f"{value} is no finite number", "Give a number")
    for option, value in gains.items():
        _refuse_beyond(option, value)


def _refuse_beyond(option: str, value: float) -> None:
    from tune.documents.scene import LARGEST, SMALLEST

    if value and not SMALLEST <= abs(value) <= LARGEST:
        seen = f"{value:g} is beyond {SMALLEST:g} to {LARGEST:g}"
        raise UsageError(option, seen, "Give a number within, or leave it out")


def _filters(
    velocity: str | None, acceleration: str | None, ratio: float | None, others: Filters
) -> Filters:
    """The filters given as a cut-off, Hz, or with kind and order behind it; else the others."""
    from tune.documents.estimators import DERIVATIVES, strange_order
    from tune.documents.scene import LoopFreedom
    from tune.loop.loop import filter_of

    settings: dict[str, Any] = {} if ratio is None else {"filter_damping_ratio": ratio}
    for which, text in zip(DERIVATIVES, (velocity, acceleration), strict=True):
        if text is None:
            continue
        option, name = f"--{which}-filter", f"{which}_filter"
        first, kind, order, *_ = (*text.split(","), "", "")
        try:
            hertz = float(first)
        except ValueError:
            hertz = math.nan
        if not (math.isfinite(hertz) and hertz > 0):
            remedy = "Give Hz above zero, or leave it out"
            raise UsageError(option, f"{first} is no cut-off", remedy)
        _refuse_beyond(option, hertz)
        known, _, usual = filter_of(others, which)
        kind = kind or known
        if kind not in {"low-pass", "tracking"}:
            raise UsageError(option, f"{kind} is no kind", "Give low-pass or tracking")
        if kind != known:
            usual = LoopFreedom.model_validate({name: kind}).kind(which)[1]
        number: object = int(order) if order.isdecimal() else order or usual
        if wrong := strange_order(which, cast("FilterKind", kind), number):
            raise UsageError(option, wrong, "Give another order, or leave it out")
        settings |= {name: kind, f"{name}_hz": hertz, f"{name}_order": number}
    return replace(others, **settings)


def _nearest(found: Audit) -> dict[str, float]:
    """Safe values by effect, those that were looked for; empty where none was found."""
    nearest = {} if found.nearest is None else found.nearest.present()
    return {name: float(value) for name, value in nearest.items()}


def _audit_details(found: Audit) -> dict[str, object]:
    """What the table shows for programs; what was not computed is null."""
    from tune.judging import ELEMENT

    margins, design = found.margins, found.design
    limit, box = design.device.force_limit, design.device.simultaneous_box()
    return {
        "safe": found.safe,
        "box": {"mass": box.mass, "damping": box.damping, "from_logs": bool(design.device.logs)},
        "loop": design.loop,
        "needed": {
            "gain_margin": design.margin.gain,
            "extra_delay_samples": design.margin.extra_delay_samples,
            "sustained_force": limit and limit.continuous,
            "peak_force": limit and limit.peak,
            "ripple": design.ripple_limit,
            "lead": found.lead,
        },
        "gain_margin": found.gain,
        "extra_delay_samples": found.delay_samples,
        "jitter": found.jitter,
        "sustained_force": found.sustained,
        "peak_force": found.peak,
        "ripple": found.ripple,
        "one_count": found.jumps,
        "wall": found.wall,
        "speed": design.elements[ELEMENT].motion.speed,
        "slowest_decay": margins and margins.decay,
        "damping_ratio": margins and margins.damping_ratio,
        "phase_margin_degrees": margins and margins.phase,
        "disk_margin": margins and margins.disk,
        "critical_frequency_hz": margins and margins.critical_frequency_hz,
        "passive": margins and found.passivity.passive,
        "passive_above_damping": margins and found.passivity.damping_needed,
        "faults": found.faults,
        "nearest": None if found.nearest is None else _nearest(found),
    }


@command()
def check_command(
    session: Session,
    profile: Annotated[Path, Argument(help="profile.yaml")],
    device: Annotated[
        str | None,
        Option(
            metavar="DEVICE",
            help="device.yaml, or the name of a known device: it must be the profile's, and the "
            "rehearsal is repeated.",
        ),
    ] = None,
    picture: Picture = None,
) -> None:
    """Re-compute all that a profile says; exit code 6 if anything differs."""
    from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST, check
    from tune.presentation.tables import certificate_lines, effects_table, verdict_on

    session.target(picture, profile, None if device is None else Path(device))
    known = None if device is None else ident.as_stored(ident.load_device(device))
    with session.progress("re-computing the certificate") as say:
        report = check(profile, known)
        if known is not None:
            refuse_restless(report.profile, say)
    session.details["profile"] = ident.to_mapping(report.profile)
    session.details["certificate"] = ident.to_mapping(report.certificate)
    session.say(f"{profile} passed: what it claims was found anew; --verbose lists what is trusted")
    session.say(verdict_on(report.profile))
    session.say(effects_table(report.profile, everything=session.verbose))
    session.detail(*certificate_lines(report.certificate))
    trusted = {**TAKEN_ON_TRUST}
    if known is not None:
        del trusted["device"]
    session.details["taken_on_trust"] = trusted
    session.detail(*(f"taken on trust: {key}: {reason}" for key, reason in trusted.items()))
    session.details["not_checked"] = OPINIONS
    session.detail(*(f"not checked: {key}: {reason}" for key, reason in OPINIONS.items()))
    if known is not None:
        session.details["rehearsed"] = "settles"
        session.say(f"the device is {device}; rehearsed in simulation: settles")
    draw_profile(session, picture, report.profile)


@command()
def compare_command(
    session: Session,
    old: Annotated[str, Argument(metavar="OLD", help="device.yaml or profile.yaml")],
    new: Annotated[
        str,
        Argument(
            metavar="NEW",
            help="another of its kind; with an old profile also a device.yaml or a known device",
        ),
    ],
    later: Annotated[
        list[str] | None,
        Argument(help="Further ones, as of later years: the last is judged, all are drawn."),
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Where to write it as a page of HTML.")
    ] = None,
    picture: Picture = None,
) -> None:
    """Is it safe still, proved or not, and felt alike; ends with 6 if the old profile fails."""
    from tune.documents.changes import one_factor
    from tune.judging import compare

    names = (old, new, *(later or ()))
    session.target(output, *map(Path, names))
    session.target(picture, *map(Path, names), output)
    loaded = [_load(name) for name in names]
    first, last = loaded[0], loaded[-1]
    with session.progress(f"comparing {old} with {names[-1]}"):
        found = compare(first, last)
    devices = {
        f"{name}{'' if (each := _device_of(item)).date is None else f', {each.date}'}": each
        for name, item in zip(names, loaded, strict=True)
    }
    motion = _device_of(first).motion
    table = _comparison_table(found, old, names[-1], motion)
    factor = one_factor(found.changes)
    session.details |= _comparison_details(found) | {"one_factor": factor}
    scale = "explains mass, damping and friction, as a torque constant or gain of the drive would"
    why = f"; one factor of {factor.value:.4g} {scale}" if factor else ""
    verdicts = _verdicts(found, why, old, names[-1], motion)
    session.say_each(verdicts)
    session.say(table)
    session.draw(picture, lambda: ident.devices_picture(devices))
    if output is not None:
        from tune.presentation.page import summary_html

        title, drawn = f"{old} and {names[-1]}", ident.devices_picture(devices)
        words = "Each device with its 95 % intervals, the first at the top."
        session.store(output, summary_html(title, verdicts, [table], drawn, words).encode())
    if found.failures and not found.at_margin:
        raise CheckFailedError((f"{verdicts[0]}. Tune again for it", *found.failures))


def _device_of(item: Device | SafeProfile) -> Device:
    return item if isinstance(item, ident.Device) else item.device


def _verdicts(found: Comparison, why: str, old: str, new: str, motion: Motion) -> list[str]:
    """Safe or not proved, where a profile was judged; what feels different; what changed."""
    lines: list[str] = []
    if found.holds:
        lines.append(f"safe: {old} holds on the device of {new}, every combination with its margin")
    elif found.at_margin:
        lines.append(
            f"at its margin: {old} is proved on the device of {new}, which did not change beyond "
            f"both intervals, with a gain margin of {found.gain:.4g}; tune again for all of it"
        )
    elif found.failures:
        kept = "" if found.gain is None else f"; a gain margin of {found.gain:.3g} is proved there"
        lines.append(f"not proved: {old} does not hold on the device of {new}{kept}")
    changes = {change.name: change for change in (*found.changes, *found.effects)}
    told = [_felt_words(each, changes[each.name], motion) for each in found.felt if each.differs]
    lines.append(f"feels {'different: ' + ', '.join(told) if told else 'the same: no step apart'}")
    beyond = ", ".join(_plain(change.name) for change in found.changes if change.beyond)
    changed = f"changed beyond both 95 % intervals: {beyond}{why}"
    lines += [f"not called the same: {', '.join(found.renamed)}"] if found.renamed else []
    return [*lines, changed if beyond else "nothing of the device changed beyond both intervals"]


def _felt_words(felt: Felt, change: Change, motion: Motion) -> str:
    """An effect, or the device's own mass or damping: from, to, and the steps between."""
    from tune.presentation.tables import plain_number, units_of

    unit = units_of(motion)[_kind_of(felt.name) or ""]
    old, new = ((side and side.value) or 0.0 for side in (change.old, change.new))
    words = f"{_plain(felt.name)} {plain_number(old)} → {plain_number(new)} {unit}"
    return f"{words} ({felt.steps:+.2g} steps)"


def _kind_of(name: str) -> str | None:
    """What the unit of a quantity is called, of an effect and of an entry by axis too; None: s."""
    last = name.rpartition(".")[2]
    whole = (_UNITS.get(name), last if last in _UNITS.values() else None)
    parts = [kind for key, kind in _UNITS.items() if last.startswith(f"{key}_")]
    return next((kind for kind in (*whole, *parts) if kind is not None), None)


def _plain(name: str) -> str:
    """A key of a file, or an effect of an element, in words."""
    return name.replace(".", " ").replace("_", " ")


def _load(reference: str) -> Device | SafeProfile:
    """A profile, its digest compared, or else a device."""
    from tune.documents.profile import load_profile

    path = Path(reference)
    if reference not in ident.named_devices() and path.is_file():
        schema = str(ident.load_mapping(path).get("schema", ""))
        if schema.startswith("haptune/profile/"):
            return load_profile(path)
    return ident.load_device(reference)


def _comparison_table(found: Comparison, old: str, new: str, motion: Motion) -> Table:
    """One row a quantity: both values with their intervals, the change, the verdict."""
    from tune.presentation.tables import headed_table, units_of

    units = units_of(motion)
    table = headed_table(
        f"{old} → {new}",
        ("quantity", "unit", "old", "new", "change", "beyond"),
        right=("old", "new", "change"),
    )
    for change in (*found.changes, *found.effects):
        kind = _kind_of(change.name)
        table.add_row(
            _plain(change.name),
            "s" if kind is None else units[kind],
            _interval_words(change.old),
            _interval_words(change.new),
            "-" if change.part is None else f"{change.part:+.1%}",
            "-" if change in found.effects else "yes" if change.beyond else "no",
        )
    return table


def _interval_words(side: Interval | None) -> str:
    """Value and half of its interval; both ends where there is no value between them."""
    if side is None:
        return "-"
    if side.value is None:
        return f"{side.low:.4g} .. {side.high:.4g}"
    return f"{side.value:.5g}" + (f" ± {side.half_width:.2g}" if side.half_width else "")


def _comparison_details(found: Comparison) -> dict[str, object]:
    def plain(changes: tuple[Change, ...]) -> list[dict[str, object]]:
        return [
            {
                **asdict(each),
                "half_widths": [side and side.half_width for side in (each.old, each.new)],
                "part": each.part,
                "beyond": each.beyond,
            }
            for each in changes
        ]

    return {
        "kind": found.kind,
        "changes": plain(found.changes),
        "effects": plain(found.effects),
        "felt": [{**asdict(each), "differs": each.differs} for each in found.felt],
        "renamed": found.renamed,
        "holds": found.holds,
        "at_margin": found.at_margin,
        "gain": found.gain,
    }


@command(without=("reference",))
def verify_command(
    session: Session,
    profile: Annotated[Path, Argument(help="profile.yaml")],
    log: Annotated[
        Path | None,
        Argument(
            help="Log of an element played at reduced gain: handle displaced or pushed, hand off. "
            "Without one: says what to play."
        ),
    ] = None,
    element: Annotated[
        str | None, Option(metavar="NAME", help="Element played, A+B for two; default: found out.")
    ] = None,
    gain: Annotated[
        float | None, Option(metavar="X", help="Gain it was played at; default: found out.")
    ] = None,
    release: Annotated[
        float | None,
        Option(
            metavar="SECONDS",
            help="When the hand let go, in the time of the log; default: largest displacement, "
            "without a spring where speed begins to fall.",
        ),
    ] = None,
    *,
    options: LogOptions,
    picture: Picture = None,
) -> None:
    """Does a low-gain closed-loop log behave as the profile predicts? Ends with 6 if not."""
    from tune.documents.profile import load_profile
    from tune.verification import margins_of_others, verification_picture, verify

    if log is None:
        if picture is not None:
            raise UsageError("--picture", "there is no log to draw", "Give a LOG")
        _plan(session, load_profile(profile), element)
        return
    session.target(picture, profile, log)
    safe = load_profile(profile)
    columns, device = options.columns(), safe.device
    axis = columns.axis or (None if device.axes else device.axis)
    trajectory = ident.load_log(log, columns, motion=device.motion, axis=axis, axes=device.axes)
    tell_reading(session, trajectory)
    with session.progress(f"comparing {log.name} with {profile.name}") as say:
        seen = verify(safe, trajectory, element=element, gain=gain, release=release)
        others = margins_of_others(seen.profile, seen.delay, say)
    session.say(_verification_table(seen))
    session.details |= _verification_details(seen, others)
    session.draw(picture, lambda: verification_picture(seen))
    if seen.disagreements:
        lines = [f"{seen.source} is not as the profile predicts"]
        for each in seen.disagreements:
            lines += [f"  {each.summary}", *([f"    {each.remedy}"] if each.remedy else [])]
        raise CheckFailedError(("\n".join(lines),))
    if not seen.assessed:
        seen.refuse_unassessed(_advice(session, safe, seen))
    session.say(
        f"{log.name} behaves as {profile.name} predicts, where it was assessed: "
        f"{seen.played} keeps its margin at every delay that the log allows"
    )
    session.say_each(
        f"it does not tell this of {'+'.join(each.elements)}: were the delay "
        f"{ident.counted(f'{each.lost_at:.3g}', 'sample')}, the margin would be lost"
        for each in others
        if each.lost_at is not None
    )


def _plan(session: Session, safe: SafeProfile, element: str | None) -> None:
    """What to play for every element, or for the one named, in each principal direction."""
    from tune.presentation.tables import headed_table
    from tune.verification import advise, along, comparable, principal_directions

    details: list[dict[str, object]] = []
    for direction, design in principal_directions(safe):
        with session.progress() as say:
            advice = advise(design, comparable(design, direction, element), say)
        where = along(design, direction)
        table = headed_table(f"what to play{where}", ("to verify", "play"))
        for each in advice:
            table.add_row(" + ".join(each.elements), each.words(design.device.motion))
        session.say(table)
        details += _advice_details(advice, direction)
    session.details["play"] = details


def _advice(session: Session, safe: SafeProfile, seen: Verification) -> str:
    """What to do where the log of a combination cannot tell: of several axes along which line."""
    from tune.verification import advise, along, principal_directions

    allowed, own = seen.delay.allowed, seen.direction
    # The heaviest first: friction that is not alike on all axes turns its motion least.
    places = [(own, seen.profile)] if own is None else principal_directions(safe)[::-1]
    found: list[tuple[tuple[float, ...] | None, Advice, bool]] = []
    for direction, design in places:
        with session.progress() as say:
            (advice,) = advise(design, (seen.elements,), say)
        play = advice.play
        more = play is not None and (
            play.elements != seen.elements or play.gain > _MORE * seen.gain
        )
        if direction is not None and own is not None and play is not None:
            more |= abs(sum(a * b for a, b in zip(direction, own, strict=True))) < _ALONG
        found.append((direction, advice, more))
    # The direction that tells, else the first in which anything can be played.
    direction, advice, more = max(found, key=lambda each: (each[2], each[1].play is not None))
    session.details["play"] = _advice_details((advice,), direction)
    if more or allowed is None or allowed.delays is None:
        told, play = advice.words(seen.profile.device.motion), advice.play
        if play is None:
            return f"{told}."
        again = not more and play.gain * _MORE >= seen.gain
        begin = "After what is said of the other checks, again" if again else "Instead"
        return f"{begin}{along(safe, direction)}: {told}."
    low, high = allowed.delays
    return (
        "No gain tells more. Push it faster; if that tells no more either, state the delay of the "
        f"device as {low:.3g} to {high:.3g} samples (value, low and high, in s) and tune again."
    )


def _advice_details(
    advice: Iterable[Advice], direction: tuple[float, ...] | None
) -> list[dict[str, object]]:
    def play(each: Advice) -> dict[str, object] | None:
        if each.play is None:
            return None
        told = asdict(each.play)
        return {"combination": told.pop("elements"), "direction": direction, **told}

    return [{"to_verify": e.elements, "play": play(e), "why": e.why, "add": e.add} for e in advice]


def _verification_table(seen: Verification) -> Table:
    from tune.presentation.tables import headed_table

    table = headed_table(
        f"{seen.source}: {seen.played}", ("check", "verdict", "seen", "predicted", "tolerance")
    )
    for column in table.columns[:2]:
        column.no_wrap = True
    for each in seen.outcomes:
        table.add_row(each.check, each.verdict, each.seen, each.predicted, each.tolerance)
    return table


def _verification_details(seen: Verification, others: tuple[Kept, ...]) -> dict[str, object]:
    allowed = seen.delay.allowed
    kept = [each for each in (seen.delay.kept, *others) if each is not None]
    return {
        "log": seen.source,
        "elements": seen.elements,
        "direction": seen.direction,
        "gain": seen.gain,
        "checks": seen.outcomes,
        "filters": seen.cutoffs,
        "delay": allowed and allowed.delays,
        "longer_delays_not_looked_at": allowed is not None and allowed.open_ended,
        "margins": [{"combination": each.elements, "lost_at": each.lost_at} for each in kept],
    }
