"""Pictures show what is true: boundaries, responses, limits and labels, against other algebra."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from datasets_synthetic import bundled_path
from identification import Hardware, identify, load_device, load_document, load_trajectory
from identification.pictures.identified import identified_picture
from identification.pictures.residual import autocorrelation
from tests.commands import haptune, log_text
from tune import SafeProfile, Scene, optimise, profile_picture
from tune.cli.drawing import draw
from tune.cli.session import Session
from tune.loop.filters import filters_of
from tune.loop.state_space import SampledLoop, corners_of
from tune.presentation.boundaries import Boundaries
from tune.presentation.element_picture import element_picture
from tune.presentation.labels import place_labels
from tune.presentation.limits import uses_of
from tune.presentation.responses import impact_response, step_response
from tune.presentation.units import UNITS

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


def test_no_text_of_a_profile_falls_on_another(profile: SafeProfile) -> None:
    assert _overlaps(profile_picture(profile)) == []
    drawn = element_picture(profile, "wall")
    assert _overlaps(drawn) == []
    words = " ".join(text.get_text() for axes in drawn.axes for text in axes.texts)
    assert "8 of 14 N" in words


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
    draw(session, tmp_path / name, Figure(figsize=(1, 1)))
    assert (tmp_path / name).read_bytes().startswith(begins)
