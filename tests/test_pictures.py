"""Pictures show what is true: boundaries, responses, limits and labels, against other algebra."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from datasets_synthetic import bundled_path, named_rig, simulate
from identification import Device, Hardware, identify, load_device, load_document, load_trajectory
from identification.pictures import autocorrelation, draw_friction, identified_picture
from tests.commands import haptune, log_text
from tune import SafeProfile, Scene, optimise, profile_picture, profile_sheet
from tune.cli.session import Session
from tune.documents.effects import UNITS
from tune.documents.profile import Design, ElementProfile, LoopProfile, MarginProfile, Margins
from tune.documents.scene import Motion
from tune.loop.loop import filters_of
from tune.loop.state_space import SampledLoop, corners_of
from tune.presentation.pictures import (
    element_picture,
    impact_response,
    place_labels,
    step_response,
    uses_of,
    words_of_shown,
)
from tune.presentation.regions import Boundaries

DEVICE = load_device("homerehab")
#: A name that matplotlib would take for a broken formula.
WATER = "$x^{$<b>"


@pytest.fixture(scope="module")
def profile() -> SafeProfile:
    elements = {
        "wall": {"stiffness": 800.0, "damping": 20.0, "penetration": 0.01},
        WATER: {"damping": 10.0},
    }
    scene = {"elements": elements, "loop": {"velocity_filter_hz": 50.0}}
    return optimise(DEVICE, Scene.model_validate(scene))


def _stable(profile: SafeProfile, stiffness: float, damping: float) -> bool:
    """At every corner of the box, by the eigenvalues of the loop from sample to sample."""
    device = profile.device
    return all(
        np.abs(np.linalg.eigvals(loop.pushed)).max() < 1
        for place in corners_of(device, device.simultaneous_box())
        for loop in [SampledLoop.of(place, filters_of(profile.loop), (stiffness, damping, 0.0))]
    )


def test_the_boundary_of_the_worst_corner_is_where_eigenvalues_leave_the_circle(
    profile: SafeProfile,
) -> None:
    damping = np.array([0.0, 20.0, 150.0])
    found = Boundaries.of(profile).at_worst(damping, 0.0)
    for edge, beside in zip(found, damping, strict=True):
        assert _stable(profile, 0.999 * float(edge), float(beside))
        assert not _stable(profile, 1.001 * float(edge), float(beside))


def test_the_margin_lies_within_and_its_damping_is_on_it(profile: SafeProfile) -> None:
    boundaries = Boundaries.of(profile)
    damping = np.linspace(0, 100, 7)
    assert np.all(boundaries.with_margin(damping, 0.0) < boundaries.at_worst(damping, 0.0))
    edge = boundaries.damping_with_margin(800.0, 20.0, 0.0)
    for factor, kept in ((0.999, True), (1.001, False)):
        at = float(boundaries.with_margin(np.array(factor * edge), 0.0))
        assert (at > 800.0) is kept


def test_a_step_ends_where_the_spring_balances_it(profile: SafeProfile) -> None:
    found = step_response(profile, profile.elements["wall"], 4.0)
    assert found.position[:, -1] == pytest.approx(4.0 / 800.0, rel=0.02)
    water = step_response(profile, profile.elements[WATER], 4.0)
    assert water.speed[0, -1] == pytest.approx(4.0 / (DEVICE.damping.value + 10.0), rel=0.01)


def test_an_impact_starts_at_the_speed_of_the_motion(profile: SafeProfile) -> None:
    """A free device of mass m enters water: its momentum is what both dampings take."""
    found = impact_response(profile, profile.elements[WATER])
    assert found.speed[0, 0] == profile.elements[WATER].motion.speed
    step = profile.loop.sample_time
    taken = -float(np.sum(found.force[0])) * step + DEVICE.damping.value * float(
        np.trapezoid(found.speed[0], found.time)
    )
    lost = DEVICE.mass.value * float(found.speed[0, 0] - found.speed[0, -1])
    assert taken == pytest.approx(lost, rel=0.01)


def test_what_binds_is_used_up(profile: SafeProfile) -> None:
    uses = {use.limit: use for use in uses_of(profile, "wall", UNITS["linear"])}
    assert uses["sustained force"].part == pytest.approx(800.0 * 0.01 / 14.0)
    assert uses["gain margin"].part == pytest.approx(2 / profile.elements["wall"].margins.gain)
    assert all(use.part < 1.001 for use in uses.values())


def test_a_force_limit_is_used_up_by_what_is_felt_at_once() -> None:
    """Felt at once, the wall's 8 N and the water's 0.2 m/s times 10 N·s/m act together."""
    motion = Motion(penetration=0.01, speed=0.2, acceleration=2.0)
    sizes = {"wall": (800.0, 0.0), WATER: (0.0, 10.0), "cup": (0.0, 5.0)}
    margins = Margins(gain=4.0, extra_delay_samples=3.0, passive="not-applicable")
    design = Design(
        device=DEVICE,
        scene="two",
        loop=LoopProfile(sample_time=0.001, extra_delay_samples=1.0),
        margin=MarginProfile(name="balanced", gain=2.0, extra_delay_samples=1),
        elements={
            name: ElementProfile(
                stiffness=K,
                damping=B,
                mass=0.0,
                perceived_steps={},
                margins=margins,
                limited_by={"damping": "wanted"},
                motion=motion,
            )
            for name, (K, B) in sizes.items()
        },
        together=(("wall", WATER),),
        ripple_limit=0.1,
    )
    used = {
        name: {use.limit: use for use in uses_of(design, name, UNITS["linear"])} for name in sizes
    }
    assert used["wall"]["force in motion"].part == pytest.approx(10.0 / 28.0)
    assert used["wall"]["force in motion"].words == f"8 of 28 N, 10 with {WATER}"
    assert used["wall"]["sustained force"].words == "8 of 14 N"
    assert used[WATER]["force in motion"].words == "2 of 28 N, 10 with wall"
    assert used["cup"]["force in motion"].words == "1 of 28 N"
    assert words_of_shown(design) == ""
    elements = {f"{name} {k}": each for k in range(5) for name, each in design.elements.items()}
    many = design.model_copy(update={"elements": elements, "together": ()})
    assert words_of_shown(many) == "of 15 elements the first 12 are drawn one by one"
    assert words_of_shown(many) in [text.get_text() for text in _sheet_texts(many)]


def _sheet_texts(design: Design) -> list[Text]:
    """Texts on the overview of a sheet, without the pictures of each element, which take long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tune.presentation.pictures._draw_element", lambda *_: None)
        return [text for part in profile_sheet(design).subfigs for text in part.texts]


def test_friction_by_direction_lies_where_the_log_shows_it() -> None:
    """Damping of 14 and 6 N·s/m by direction with an offset of 2 N, which the pair holds."""
    rig = replace(named_rig("homerehab"), damping_asymmetry=4.0, force_offset=2.0)
    sweep = 2.0 + 10.0 * np.sin(2 * np.pi * 0.7 * np.arange(8000) * 1e-3)
    log = simulate(rig, sweep).trajectory()
    pairs = {
        "damping_by_direction": {"forward": 14.0, "backward": 6.0},
        "friction_by_direction": {"forward": 2.8, "backward": 0.0},
    }
    # The offset of a fit about the mean speed is another than that at rest.
    device = Device.model_validate({**dict(DEVICE), **pairs, "force_offset": 3.1})
    axes = Figure().add_subplot()
    draw_friction(axes, log, device, None, "N")
    middles = [line for line in axes.lines if line.get_marker() == "o"]
    assert len(middles) == 2
    for line in middles:
        speed, seen = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        told = np.where(speed > 0, 2.8 + 14.0 * speed, 1.2 + 6.0 * speed)
        assert np.median(np.abs(seen - told)) < 0.1


def _overlaps(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts within the same axes, tick labels left out, that fall on one another."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    found: list[tuple[str, str]] = []
    for axes in figure.axes:
        texts = [text for text in axes.texts if text.get_text()]
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label]
        boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in texts]
        found += [
            (one, other)
            for (one, first), (other, second) in combinations(boxes, 2)
            if one and other and first.overlaps(second)
        ]
    return found


def test_labels_of_points_that_nearly_fall_together_do_not() -> None:
    figure = Figure(figsize=(5, 4))
    axes = figure.add_subplot()
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    points = [(0.5 + 0.004 * k, 0.5, f"an element {k}") for k in range(8)] + [(1.0, 0.0, "corner")]
    labels = place_labels(axes, points)
    assert [label.get_text() for label in labels] == [text for *_, text in points]
    assert _overlaps(figure) == []


def test_a_label_without_room_is_left_out_and_no_line_crosses_a_label() -> None:
    figure = Figure(figsize=(2.5, 2))
    axes = figure.add_subplot()
    points = [(0.5 + 0.002 * k, 0.5, f"thing {k}") for k in range(40)]
    labels = place_labels(axes, points)
    assert 0 < len(labels) < 40
    assert _overlaps(figure) == []
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [label.get_window_extent(renderer) for label in labels]
    arrows = [text.arrow_patch for text in axes.texts if isinstance(text, Annotation)]
    paths = [arrow.get_path() for arrow in arrows if arrow is not None]
    crossed = [sum(path.intersects_bbox(box, filled=False) for box in boxes) for path in paths]
    assert max(crossed, default=0) <= 1


def test_no_text_of_a_profile_falls_on_another(profile: SafeProfile) -> None:
    assert _overlaps(profile_picture(profile)) == []
    drawn = element_picture(profile, "wall")
    assert _overlaps(drawn) == []
    words = " ".join(text.get_text() for axes in drawn.axes for text in axes.texts)
    assert "8 of 14 N" in words


def test_a_picture_calls_safe_only_what_is(
    profile: SafeProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tune.presentation.pictures._draw_element", lambda *_: None)
    titles: list[str] = []
    monkeypatch.setattr(Session, "draw", lambda *given: titles.append(_title(given[2]())))
    picture = str(tmp_path / "audit.png")
    assert haptune("audit", "homerehab", "--stiffness", "30000", "--picture", picture).code == 6
    assert titles[0].endswith("NOT SAFE: stability and force")
    assert ": safe for every gain up to 2 with 1 extra sample" in _title(profile_sheet(profile))
    design = Design.model_validate({name: getattr(profile, name) for name in Design.model_fields})
    assert ": margin: every gain up to 2" in _title(profile_sheet(design))


def _title(figure: Figure) -> str:
    """The title of the overview on a sheet."""
    title = figure.subfigs[0].get_suptitle()
    assert title
    return title


def test_correlation_is_that_of_a_known_process() -> None:
    noise = np.random.default_rng(4).standard_normal(40_000)
    column = np.empty_like(noise)
    last = 0.0
    for row, value in enumerate(noise):
        last = column[row] = 0.6 * last + value
    assert autocorrelation(column, 3) == pytest.approx([1, 0.6, 0.36, 0.216], abs=0.03)


@pytest.mark.long
def test_an_identification_is_drawn_with_the_interval_of_before() -> None:
    log = load_trajectory(bundled_path("homerehab.csv")).part(slice(0, 2000))
    hardware = load_document(Hardware, bundled_path("homerehab.hardware.yaml"))
    found = identify(log, hardware=hardware, method="least-squares")
    figure = identified_picture(found.device, found.logs, before=DEVICE)
    words = [label.get_text() for axes in figure.get_axes() for label in axes.get_yticklabels()]
    assert {"now", "before", "least-squares"} <= set(words)
    lines = [line for axes in figure.get_axes() for line in axes.get_lines()]
    green = next(line for line in lines if line.get_label() == "b·q̇ + Fc·sign(q̇)")
    speed, force = np.asarray(green.get_xdata()), np.asarray(green.get_ydata())
    device = found.device
    expected = device.coulomb_friction.value + device.damping.value * speed
    np.testing.assert_allclose(force, expected)


def test_a_log_that_is_refused_is_drawn_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("noise.csv").write_text(log_text(), encoding="utf-8")
    assert haptune("doctor", "noise.csv", "--picture", "seen.svg").code == 4
    assert b"<svg" in Path("seen.svg").read_bytes()
    assert haptune("doctor", "noise.csv", "--picture", "noise.csv").code == 2


@pytest.mark.parametrize(
    ("name", "begins"), [("a.png", b"\x89PNG"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF")]
)
def test_a_picture_is_what_its_name_says(name: str, begins: bytes, tmp_path: Path) -> None:
    session = Session(command="tune", as_json=False, quiet=True)
    session.draw(tmp_path / name, lambda: Figure(figsize=(1, 1)))
    assert (tmp_path / name).read_bytes().startswith(begins)
