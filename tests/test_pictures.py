"""Pictures show what is true: boundaries, limits and labels, against other algebra."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from identification import load_device
from tests.commands import haptune, log_text
from tune import (
    Effects,
    Filters,
    Loop,
    SafeProfile,
    Scene,
    is_stable,
    optimise,
    profile_picture,
    profile_sheet,
)
from tune.cli.session import Session
from tune.presentation.limits import Boundaries

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
    """At every corner of the box."""
    box = profile.device.simultaneous_box()
    return all(
        is_stable(
            Loop.from_numbers(
                mass=mass,
                damping=own,
                sample_time=1e-3,
                delay_samples=1.0,
                filters=Filters(velocity_filter_hz=50.0),
            ),
            Effects(stiffness=stiffness, damping=damping or None),
        )
        for mass in box.mass
        for own in box.damping
    )


def test_the_boundary_of_the_worst_corner_is_the_last_that_is_stable(profile: SafeProfile) -> None:
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


def test_no_text_of_a_profile_falls_on_another(profile: SafeProfile) -> None:
    assert _overlaps(profile_picture(profile)) == []


def test_a_picture_calls_safe_only_what_is(
    profile: SafeProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tune.presentation.pictures.draw_slice", lambda *_: None)
    titles: list[str] = []
    monkeypatch.setattr(Session, "draw", lambda *given: titles.append(_title(given[2]())))
    picture = str(tmp_path / "audit.png")
    assert haptune("audit", "homerehab", "--stiffness", "30000", "--picture", picture).code == 6
    assert titles[0].endswith("NOT SAFE: stability and force")
    assert ": safe for every gain up to 2 with 1 extra sample" in _title(profile_sheet(profile))


def _title(figure: Figure) -> str:
    """The title of the overview on a sheet."""
    title = figure.subfigs[0].get_suptitle()
    assert title
    return title


def test_a_log_that_is_refused_is_drawn_all_the_same(here: Path) -> None:
    Path("noise.csv").write_text(log_text(), encoding="utf-8")
    for name, begins in (("a.png", b"\x89PNG"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF")):
        assert haptune("doctor", "noise.csv", "--picture", name).code == 4
        assert Path(name).read_bytes().startswith(begins)
    assert haptune("doctor", "noise.csv", "--picture", "noise.csv").code == 2
