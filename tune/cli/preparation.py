"""What needs no device: ``haptune new``, ``excite``, ``simulate``, ``open``; rehearsing profiles.

Templates, a force to play and a simulated log come before a log is taken; none of it drives
hardware. Before a profile is written it is played on a simulated device; what does not settle is
vetoed. The certificate is about a linear loop. Quantiser, friction, force limit and one-sided walls
are for the simulator, which shares no algebra with anything that tunes or certifies.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement, product, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

import identification as ident
from identification import UsageError
from tune.cli.session import DryRun, Session, command
from tune.documents import CheckFailedError

if TYPE_CHECKING:
    from rich.table import Table

    from datasets_synthetic import Controller, Rig, VirtualElement
    from identification import AxesExcitation, Excitation
    from tune.documents.profile import Design, ElementProfile

    _Part = tuple[ElementProfile, int, float]


#: How far each known device is moved from its middle, m (rad): room that it has by its size.
_ROOM = {"emps": 0.1, "homerehab": 0.1, "knob": 1.0, "stylus": 0.03}
#: Parts of the stiffness that the continuous force allows, of which a soft spring is one.
_SOFT = 20.0
#: A log whose force stays below this part of the continuous limit is asked for its unit.
_LIKE_AMPERES = 0.4


#: Files that have a template, and languages of the player with the endings of their files.
_Kind = Literal["hardware", "scene", "excitation", "player", "study"]
_Language = Literal["c", "python"]
_ENDINGS: dict[_Language, str] = {"c": "c", "python": "py"}


@command()
def new_command(
    session: Session,
    kind: Annotated[_Kind, Argument(help="What to write.")],
    device: Annotated[
        str | None, Option(help="Fill in what suits a known device, such as homerehab.")
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            help="Where to write; default KIND.yaml, player.c, player.py, study.ipynb.",
        ),
    ] = None,
    language: Annotated[_Language | None, Option(help="Of the player; default c.")] = None,
    dry_run: DryRun = False,
) -> None:
    """Write a commented template of hardware.yaml, scene.yaml or excitation.yaml, or a program.

    player plays a planned force; study, a notebook, replays the paper's experiment.
    """
    if language is not None and kind != "player":
        raise UsageError("--language", f"is of no {kind}", "Leave it out")
    filled = {"hardware": hardware_of, "scene": scene_of, "excitation": excitation_of}
    if device is not None and kind not in filled:
        raise UsageError("--device", f"fills in no {kind}", "Leave it out")
    ending = {"player": _ENDINGS[language or "c"], "study": "ipynb"}.get(kind, "yaml")
    path = output or Path(f"{kind}.{ending}")
    session.target(path)
    text = template(kind, ending) if device is None else filled[kind](device)
    session.write(path, text, dry_run=dry_run)
    if kind == "player":
        session.say("fill in how your device is read and driven; haptune never drives it")
    elif kind == "study":
        session.say(f"run it in Jupyter, or: jupyter execute --inplace {path}")
    elif kind != "scene" and device is None:
        known = ", ".join(ident.named_devices())
        session.say(f"fill in what is blank; known devices for --device: {known}")


def template(kind: str, ending: str = "yaml") -> str:
    """Text of a file of ``tune/templates``."""
    from importlib.resources import files

    return (files("tune") / "templates" / f"{kind}.{ending}").read_text(encoding="utf-8")


def excitation_of(name: str) -> str:
    """The template of an excitation with what is known of a known device filled in."""
    from numpy import format_float_positional

    if name not in ident.named_devices():
        known = f"Give one of {', '.join(ident.named_devices())}"
        raise UsageError("--device", f"{name} is no known device", known)
    device = ident.load_device(name)
    limit, count = device.force_limit, device.encoder_resolution
    assert limit is not None
    assert count is not None
    guesses = (device.mass, device.damping, device.coulomb_friction)
    numbers = {
        "sample_time": device.sample_time.value,
        "force": limit.continuous,
        "travel": _ROOM[name],
        "encoder_resolution": count.value,
    }
    known = {"name": name, "axis": device.axis, "motion": device.motion}
    known |= {key: format_float_positional(value, trim="0") for key, value in numbers.items()}
    for key, guess in zip(("mass", "damping", "coulomb_friction"), guesses, strict=True):
        ends = (guess.value, guess.low, guess.high)
        value, low, high = (format_float_positional(each, trim="0") for each in ends)
        known[key] = f"{{value: {value}, low: {low}, high: {high}}}"
    lines = [f"# Guesses and limits of the known device {name}; check all of them on yours."]
    assumed = [key for key in device.assumed() if key in known]
    lines += [f"# Assumed, not known: {', '.join(assumed)}."] if assumed else []
    for line in template("excitation").splitlines():
        key, colon, rest = line.partition(":")
        if not colon or key not in known:
            lines.append(line)
            continue
        comment = rest.partition("#")[2]
        kept = f"#{comment}" if comment and "such as" not in comment else ""
        lines.append(f"{key + ': ' + known[key]:<31} {kept}".rstrip())
    return "\n".join(lines) + "\n"


def scene_of(name: str) -> str:
    """The template of a scene with sizes and motions that suit a known device or a device file."""
    from tune.documents.perception import SCALE_DEPTH, Scale, default_table
    from tune.documents.scene import DEFAULT_LEAD, DEFAULT_MOTION, UNITS, format_number

    device = ident.load_device(name)
    units, motion = UNITS[device.motion], DEFAULT_MOTION[device.motion]
    depth, damping = SCALE_DEPTH[device.motion], device.damping.value
    noticed = f"ripple_limit: {format_number(default_table().threshold(device.motion))}"
    felt = Scale.of("damping", device, default_table(), motion)
    water, cup = (float(f"{felt.value_at(float(steps), 1):.2g}") for steps in (2, 5))
    sizes = {
        "(m/s)": f"({units['speed']})",
        "(m)": f"({units['length']})",
        "penetration: 0.01": f"penetration: {depth:g}",
        "lead: 0.001": f"lead: {DEFAULT_LEAD[device.motion]:g}",
        "speed: 0.2": f"speed: {motion.speed:.1f}",
        "acceleration: 2.0": f"acceleration: {motion.acceleration:.1f}",
        "ripple_limit: 0.1         # N rms": f"{'# ' + noticed:<25} # {units['force']} rms",
    }
    for least, written in ((max(damping, water), "10.0"), (max(3 * damping, cup), "30.0")):
        sizes[f"damping: {written}"] = f"damping: {format_number(least)}"
    if device.force_limit is not None:
        stiffest = device.force_limit.continuous / depth
        softest = stiffest / _SOFT
        within = f"{{min: {format_number(softest)}, max: {format_number(stiffest)}}}"
        sizes["stiffness: {min: 200.0, max: 1500.0}"] = f"stiffness: {within}"
    if water > damping:  # the device by itself holds next to no spring, nor a mass beside a wall
        sizes["rubber: {"] = f"rubber: {{damping: {format_number(water)}, "
        sizes["- [wall, feather]"] = "- [wall, feather]\n  - [wall, cup]"
    above, elements, below = template("scene").partition("ripple_limit:")
    below = elements + below
    for before, after in sizes.items():
        below = below.replace(before, after)
    return f"# Sizes suit {name}; choose your own.\n{above}{below}"


def hardware_of(name: str) -> str:
    """The hardware part of a device as YAML, without what nobody stated of it."""
    device = ident.load_device(name)
    known = ("name", "axis", "motion", "sample_time", "delay", "encoder_resolution", "force_limit",
             "modes", "current_lag")  # fmt: skip
    hardware = ident.Hardware(**{key: getattr(device, key) for key in known})
    hardware = hardware.model_copy(update=dict.fromkeys(device.unstated()))
    return ident.to_yaml(
        ident.to_mapping(hardware), f"Hardware of the known device {name}; check it on yours."
    )


@command()
def excite_command(
    session: Session,
    spec: Annotated[Path, Argument(help="Limits and guesses; see 'haptune new excitation'.")],
    output: Annotated[
        Path, Option("-o", "--output", help="Where to write the force (CSV).")
    ] = Path("force.csv"),
    picture: Annotated[
        Path | None, Option(help="Where to draw force and predicted motion (PNG, SVG or PDF).")
    ] = None,
    dry_run: DryRun = False,
) -> None:
    """Plan a force that tells mass and damping best within limits. Drives no hardware.

    With axes: [x, y] in the file, a force for each, so that the axes can be told apart.
    """
    session.target(output, spec)
    session.target(picture, spec, output)
    wanted = ident.load_excitation(spec)
    with session.progress() as say:
        if wanted.axes is None:
            plan = ident.plan_excitation(wanted, progress=say)
            details, shown = _plan_details(plan), (_excitation_table(plan), _prediction_line(plan))
            least = plan.best.used.force
        else:
            plan = ident.plan_axes(wanted, progress=say)
            details, shown = _axes_details(plan), (_axes_table(plan), _axes_line(plan))
            least = float(abs(plan.force).max(axis=0).min()) / plan.spec.force
        text = ident.force_text(plan)
    rows = text.count("\n") - 1
    session.details |= details | _limits_details(plan) | {"rows": rows}
    for each in (*shown, _worst_table(plan)):
        session.say(each)
    if warning := _beyond_limits(plan, known=wanted.device is not None):
        session.warn(warning)
    if wanted.gentle:
        session.say(
            f"gentle first play, at most {plan.spec.force:.3g} {_units(plan)['force']} for "
            f"{plan.spec.duration:g} s: identify its log (haptune identify LOG --force-gain 1 -o "
            "first.yaml; so small a force looks like amperes), then put device: first.yaml in the "
            "place of gentle: true and plan the full force for the device identified"
        )
    elif least < _LIKE_AMPERES:
        session.say(
            f"it reaches {least:.0%} of the force limit, and so small a force looks like amperes: "
            "read its log with --force-gain 1 (doctor, identify, calibrate)"
        )
    if dry_run:  # thousands of rows would tell nobody anything
        session.say(f"dry run: {output} would be written, {rows} rows")
        return
    session.write(output, text)
    session.draw(picture, lambda: ident.excitation_picture(plan))


def _units(plan: Excitation | AxesExcitation) -> dict[str, str]:
    from tune.documents.scene import UNITS

    return UNITS[plan.spec.motion]


def _excitation_table(plan: Excitation) -> Table:
    """One row a family: bound of both intervals, and how much of the limits is used."""
    from tune.presentation.tables import headed_table

    spec, units = plan.spec, _units(plan)
    numbers = (f"mass, {units['mass']}", f"damping, {units['damping']}", "force", "travel", "speed")
    table = headed_table(
        f"{spec.name}, axis {spec.axis}: {spec.duration:g} s, least 95 % intervals "
        "any estimator can reach; the first is played",
        ("signal", "frequencies", *numbers),
        right=numbers,
    )
    for each in plan.candidates:
        bounds = (f"± {each.prediction.mass:.3g}", f"± {each.prediction.damping:.3g}")
        used = (f"{each.used.force:.0%}", f"{each.used.travel:.0%}")
        speed = "-" if spec.speed is None else f"{each.used.speed:.0%}"
        table.add_row(each.family, each.description, *bounds, *used, speed)
    return table


def _axes_table(plan: AxesExcitation) -> Table:
    """One row an entry of the matrices: its guess and the half-width of its interval."""
    from tune.presentation.tables import headed_table

    spec, units = plan.spec, _units(plan)
    table = headed_table(
        f"{spec.name}, axes {', '.join(plan.axes)}: {spec.duration:g} s, 95 % intervals as "
        "identify states them",
        ("entry", "guess", "interval", "unit"),
        right=("guess", "interval"),
    )
    pairs = [*combinations_with_replacement(plan.axes, 2)]
    entries = product(("mass", "damping"), pairs)
    for (name, (row, column)), half in zip(entries, plan.expected.values(), strict=True):
        guess = getattr(spec, name).value if row == column else 0.0
        table.add_row(f"{name} {row},{column}", f"{guess:g}", f"± {half:.3g}", units[name])
    return table


def _axes_line(plan: AxesExcitation) -> str:
    """Lines of each axis, what the forces use of the limits, and of what device that is told."""
    used = f"force {plan.used.force:.0%}, travel {plan.used.travel:.0%}"
    used += "" if plan.spec.speed is None else f", speed {plan.used.speed:.0%}"
    return (
        f"multisines with lines of their own: {plan.description}; of the limits they use {used}. "
        "The intervals are those of the guessed device, its axes not coupled"
    )


def _worst_table(plan: Excitation | AxesExcitation) -> Table:
    """One row a set of devices: how far and how fast the played force moves the worst of them."""
    from tune.presentation.tables import headed_table

    spec, units = plan.spec, _units(plan)
    numbers = (f"travel, {units['length']}", "of it", units["speed"], "of it")
    table = headed_table(
        "the played force on a device that is not as guessed: farthest and fastest",
        ("device", *numbers),
        right=numbers,
    )
    for each in plan.worst:
        travel = (f"{each.travel:.3g}", f"{each.travel / spec.travel:.0%}")
        used = "-" if spec.speed is None else f"{each.speed / spec.speed:.0%}"
        table.add_row(each.words, *travel, f"{each.speed:.3g}", used)
    return table


def _beyond_limits(plan: Excitation | AxesExcitation, *, known: bool) -> str:
    """What leaves the limits, or ""; a known device only pulled by a force nobody planned."""
    spec, units = plan.spec, _units(plan)
    allowed = f"travel {spec.travel:g} {units['length']}"
    if spec.speed is not None:
        allowed += f", speed {spec.speed:g} {units['speed']}"
    seen = "; ".join(
        f"{each.words}: {each.travel:.2g} {units['length']}, {each.speed:.2g} {units['speed']}"
        for each in plan.beyond
        if each.name.startswith("unplanned") or not known
    )
    whose = "the device named" if known else "a device that is not as guessed"
    remedy = (
        "Let nothing pull at it that its file does not tell, such as a slope or a cable; or "
        if known
        else "Plan a gentle first play with gentle: true and name the device identified from its "
        "log with device: FILE; or widen the guesses to what they may be, lower the force, "
    )
    return seen and (
        f"this force may drive {whose} against its end stops: {seen}; allowed: {allowed}. {remedy}"
        "shorten the duration (a constant force makes a device without a spring drift all along) "
        "or allow more travel"
    )


def _axes_details(plan: AxesExcitation) -> dict[str, object]:
    return {
        "candidates": [
            {"signal": "multisine", "axis": axis, "lines_hz": lines.tolist()}
            for axis, lines in zip(plan.axes, plan.lines, strict=True)
        ],
        "predicted": plan.expected,
        "stated": plan.expected,
    }


def _plan_details(plan: Excitation) -> dict[str, object]:
    spec = plan.spec
    mass, damping = plan.best.prediction.stated
    return {
        "candidates": [
            {
                "signal": each.family,
                "frequencies": each.description,
                "band_hz": each.band,
                "lines": each.lines,
                "mass": each.prediction.mass,
                "damping": each.prediction.damping,
                "force_used": each.used.force,
                "travel_used": each.used.travel,
                "speed_used": None if spec.speed is None else each.used.speed,
            }
            for each in plan.candidates
        ],
        "predicted": {"mass": plan.mass, "damping": plan.damping},
        "stated": {"mass": mass, "damping": damping},
    }


def _limits_details(plan: Excitation | AxesExcitation) -> dict[str, object]:
    spec = plan.spec
    return {
        "duration": spec.duration,
        "limits": {"force": spec.force, "travel": spec.travel, "speed": spec.speed},
        "guesses": {"mass": spec.mass.value, "damping": spec.damping.value},
        "worst": [
            {
                "device": each.name,
                "words": each.words,
                "travel": each.travel,
                "speed": each.speed,
                "travel_used": each.travel / spec.travel,
                "speed_used": None if spec.speed is None else each.speed / spec.speed,
                "beyond": each in plan.beyond,
            }
            for each in plan.worst
        ],
    }


def _prediction_line(plan: Excitation) -> str:
    """The interval predicted for both, and what the prediction rests on."""
    spec, units = plan.spec, _units(plan)
    mass, damping = units["mass"], units["damping"]
    stated = plan.best.prediction.stated
    parts = [
        f"{name} {guess:g} ± {half:.3g} {unit} (stated as ± {whole:.3g})"
        for name, guess, half, whole, unit in (
            ("mass", spec.mass.value, plan.mass, stated[0], mass),
            ("damping", spec.damping.value, plan.damping, stated[1], damping),
        )
    ]
    method = "output error" if spec.force_noise == 0 else "the innovations method"
    return (
        f"predicted 95 % intervals: {', '.join(parts)}; noise alone lets {method} reach the first, "
        "identify states the second, as it trusts no force beyond 2e-5 of it"
    )


@command()
def simulate_command(
    session: Session,
    spec: Annotated[str, Argument(help="Name of a scenario; an unknown name lists all of them.")],
    output: Annotated[Path, Option("-o", "--output", help="Where to write the log (CSV).")] = Path(
        "log.csv"
    ),
    seed: Annotated[
        int | None, Option(help="Seed of the noise; default the scenario's own.")
    ] = None,
) -> None:
    """Simulate a logged calibration of a known device with its faults. Drives no hardware."""
    from datasets_synthetic import log_text, run, scenario_named

    session.target(output)
    scenario = scenario_named(spec)
    with session.progress(f"simulating {spec}"):
        trajectory = run(scenario, seed=seed)
    session.details |= {
        "scenario": spec,
        "description": scenario.description,
        "samples": len(trajectory),
        "sample_time": trajectory.sample_time,
    }
    session.say(scenario.description)
    session.write(output, log_text(trajectory))


@command()
def open_command(
    session: Session,
    folder: Annotated[Path, Argument(help="Its files are shown; default: this one.")] = Path(),
    port: Annotated[int, Option(min=0, max=65535, help="0 takes any that is free.")] = 0,
    no_browser: Annotated[bool, Option("--no-browser", help="Only print the address.")] = False,
) -> None:
    """Serve a page on this machine alone, until Ctrl-C or the last closed tab."""
    import webbrowser

    if not folder.is_dir():
        raise UsageError("FOLDER", f"there is no folder {folder}", "Give one that exists")
    try:
        from tune.page.server import serve
    except ImportError as error:
        missing = f"needs {error.name}, which is not installed"
        raise UsageError("haptune open", missing, "pip install 'haptune[page]'") from None

    def tell(address: str) -> None:
        session.tell(f"{folder.resolve()}: {address}\nCtrl-C or the last closed tab ends it.")
        if not no_browser:
            webbrowser.open(address)

    try:
        serve(folder, port, tell)
    except OSError as error:
        raise UsageError("--port", f"{port}: {error.strerror}", "Give another, or 0") from None


#: Amplitude of force that may last, in ripples: within a count an encoder never lets it rest.
_LASTING = 3 * 2**0.5
#: Combinations played in one run: a step of a batch costs little more than one of a single device
#: until there are some hundred members, and each combination is some three dozen.
_AT_ONCE = 12
#: Devices whose mass and damping differ by no more than this factor move alike.
_ALIKE_DEVICES = 1.01
#: Length of a trial, s, and its samples at most.
_LONGEST, _MOST_SAMPLES = 3.0, 12_000
#: Walls whose lead times differ by less, in parts, are alike: one clamp of one signal.
_ALIKE = 1e-9


class RestlessError(CheckFailedError):
    """Elements of a design that do not come to rest in simulation: their names, and why."""

    def __init__(self, vetoes: dict[tuple[str, ...], str]) -> None:
        said = (f"{' + '.join(names)}: rehearsal: {why}" for names, why in vetoes.items())
        super().__init__(tuple(said))
        self.combinations = {*vetoes}
        self.elements = {name for names in vetoes for name in names}


def refuse_restless(design: Design, say: Callable[[str], None]) -> None:
    """Play combinations of unlike elements, and their transitions, in the simulator's trials.

    The design is as it will be stored, its force limit and encoder stated. Raises RestlessError
    where some trial diverges or keeps oscillating; then nothing may be written.
    """
    from datasets_synthetic import Hand, rehearse, rig_of

    hand = design.hand and Hand(**{name: each.value for name, each in design.hand})
    rig = rig_of(design.device)
    others = _other_rigs(design, rig)
    there = {name for name, element in design.elements.items() if element.acting}
    unlike = design.one_of_each().combinations()
    combinations = [names for names in unlike if there.issuperset(names)]
    runs = -(-len(combinations) // _AT_ONCE)
    vetoes: dict[tuple[str, ...], str] = {}
    for run in range(runs):
        part = combinations[run::runs]
        what = f"{' + '.join(part[0])}{' and others' if part[1:] else ''}"
        say(f"rehearsing {what} in simulation ({run + 1} of {runs})")
        found = rehearse(
            rig,
            _law(design, part),
            hand=hand,
            others=others,
            force_allowed=[_lasting(design, names) for names in part],
            duration=min(_LONGEST, _MOST_SAMPLES * design.device.sample_time.value),
        )
        for names, each in zip(part, found, strict=True):
            if each.vetoes:
                vetoes[names] = each.vetoes[0].reason
    if vetoes:
        raise RestlessError(vetoes)


def _lasting(design: Design, combination: tuple[str, ...]) -> float:
    """Amplitude that the force may keep; beside walls ripple is told, not bound."""
    from tune.certificate.claims import meets_wall

    told = sum(design.elements[name].ripple or 0.0 for name in combination)
    return _LASTING * max(design.ripple_limit, told * meets_wall(design, combination))


def _other_rigs(design: Design, rig: Rig) -> list[Rig]:
    """Devices that this one may be as well, and what friction with a memory makes of it.

    Three corners of the box of mass and damping, friction slopes in it, at the longest delay and
    the extra delay of the margin, those alike once; and the device while its friction holds it like
    a spring.
    """
    device = design.device
    box = device.simultaneous_box()
    late = box.delay[1] + design.margin.extra_delay_samples * device.sample_time.value
    (light, heavy), (least, most) = box.mass, box.damping
    corners = [(light, least)]
    corners += [(heavy, least)] if heavy > _ALIKE_DEVICES * light else []
    corners += [(light, most)] if most > _ALIKE_DEVICES * least else []
    found = [
        replace(rig, mass=mass, damping=damping, damping_asymmetry=0.0, delay=late)
        for mass, damping in corners
    ]
    held = device.presliding_stiffness
    if held is not None:
        found.append(replace(rig, stiffness=rig.stiffness + held.high))
    return found


def _law(design: Design, combinations: Sequence[tuple[str, ...]]) -> Controller:
    """The elements as the simulator plays them, one member a combination."""
    from datasets_synthetic import Calls, Controller
    from tune.documents.profile import SafeProfile

    certified = {frozenset(names) for names in design.combinations()}
    members = [_parts(design, names, certified) for names in combinations]
    settings = design.loop.filter_settings().items()
    # Samples that a gain waits for before it rises; of an uncertified design one.
    taps = design.certificate.longest_tap if isinstance(design, SafeProfile) else 1
    return Controller(
        beside=tuple(_column(column) for column in zip_longest(*members)),
        calls=Calls(taps=taps),
        **{name: value for name, value in settings if value is not None},
    )


def _parts(
    design: Design, names: tuple[str, ...], certified: Collection[frozenset[str]]
) -> list[_Part]:
    """The elements of a combination, and a wall on the other side, as near as it may stand."""
    walls = [name for name in names if name in design.walls]
    others = frozenset(names).difference(walls)
    parts = [(design.elements[name], -1 if name in walls else 0, 0.0) for name in names]
    facing = [
        name
        for name, element in design.elements.items()
        if walls
        and element.stiffness  # a wall whose spring was left out stands nowhere
        and name in design.walls.difference(walls)
        and others | {name} in certified
        and not any({name, wall} == set(pair) for wall in walls for pair in design.apart)
    ]
    for name in facing[:1]:
        leads = [_corridor(design.elements[wall], design.elements[name]) for wall in walls]
        parts.append((design.elements[name], 1, -max(leads)))
    return parts


def _corridor(wall: ElementProfile, other: ElementProfile) -> float:
    """The narrowest between two walls that is certified, m (rad): none where they are alike."""
    here, there = (each.damping / each.stiffness for each in (wall, other))
    if abs(here - there) <= _ALIKE * max(here, there):
        return 0.0
    return here * wall.motion.speed + there * other.motion.speed


def _column(parts: Sequence[_Part | None]) -> VirtualElement:
    """One part of each combination, or none of it, as one element of the batch."""
    import numpy as np

    from datasets_synthetic import VirtualElement

    rows = [(0.0, 0.0, 0.0, np.inf, 0.0, 0, 0.0)] * len(parts)
    for row, part in enumerate(parts):
        if part is not None:
            one, side, place = part
            sizes = one.stiffness, one.damping, one.mass
            rows[row] = (*sizes, one.force_level or np.inf, one.fade_time, side, place)
    columns = np.array(rows, dtype=np.float64).T
    names = ("stiffness", "damping", "mass", "level", "fade_time", "side", "place")
    return VirtualElement(**dict(zip(names, columns, strict=True)))  # pyright: ignore[reportArgumentType]
