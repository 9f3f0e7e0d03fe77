"""Each condition of a certificate and each word of a profile, half a per cent to either side."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from identification import load_device, to_mapping, to_yaml
from tests.commands import digest_of
from tune import CheckFailedError, SafeProfile, Scene, optimise
from tune.certificate.certify import certify
from tune.certificate.check import check
from tune.documents.profile import Design

OFF = 0.005


@cache
def tuned() -> SafeProfile:
    """A wall, a spring that must last as deep as is stated, something heavy, something wet."""
    elements = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
        "spring": {"stiffness": 500.0, "damping": 5.0, "penetration": 0.01},
        "cup": {"mass": "max", "damping": 30.0},
        "water": {"damping": 10.0},
    }
    scene = Scene.model_validate(
        {
            "elements": elements,
            "together": [["spring", "water"]],
            "apart": [["wall", "spring"], ["wall", "cup"]],
            "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
        }
    )
    return optimise(load_device("homerehab"), scene)


def with_element(design: SafeProfile, name: str, **update: object) -> SafeProfile:
    changed = design.elements[name].model_copy(update=update)
    return design.model_copy(update={"elements": {**design.elements, name: changed}})


def margins(design: SafeProfile, name: str, **update: object) -> SafeProfile:
    return with_element(
        design, name, margins=design.elements[name].margins.model_copy(update=update)
    )


def limit(design: SafeProfile, name: str, part: float) -> SafeProfile:
    """The continuous or peak force of the device at a part of what it is."""
    device = design.device
    assert device.force_limit is not None
    force = device.force_limit.model_copy(update={name: part * getattr(device.force_limit, name)})
    return design.model_copy(update={"device": device.model_copy(update={"force_limit": force})})


def refusals(design: Design) -> str:
    """What `certify` says against a design."""
    stated = design.certificate.absolute_stability if isinstance(design, SafeProfile) else None
    try:
        certify(design, 20_000, stated)
    except CheckFailedError as error:
        return "\n".join(error.failures)
    return ""


def _ripple(part: float) -> SafeProfile:
    noise = max(each.ripple or 0.0 for each in tuned().elements.values())
    return tuned().model_copy(update={"ripple_limit": noise * part})


def _sustained(part: float) -> SafeProfile:
    """500 N/m over 10 mm."""
    return limit(tuned(), "continuous", 5.0 / 14.0 * part)


def _peak(part: float) -> SafeProfile:
    """The cup's 30 N·s/m at 0.2 m/s and its mass at 2 m/s², below what any clamp lets pass."""
    cup = tuned().elements["cup"]
    need = 30.0 * 0.2 + cup.mass * 2.0
    plain = tuned()
    for name in ("wall", "spring"):
        plain = with_element(plain, name, force_level=0.5)
    return limit(plain, "peak", need / 28.0 * part)


def _levels(part: float) -> SafeProfile:
    return with_element(tuned(), "wall", force_level=28.0 / part)


def _gain(part: float) -> SafeProfile:
    """The gain that water bears, which is felt alone and beside the spring."""
    return margins(tuned(), "cup", gain=_edge_of_gain() / part)


@cache
def _edge_of_gain() -> float:
    return _edge(lambda gain: not refusals(margins(tuned(), "cup", gain=gain)), 2.0, 200.0)


def _edge(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The last value that holds, to 0.2 per cent."""
    while high > low * 1.002:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (_ripple, "ripple"),
        (_sustained, "sustained force"),
        (_peak, "peak force"),
        (_levels, "cut force"),
        (_gain, "claimed gain margin"),
    ],
)
def test_half_a_per_cent_decides(made: Callable[[float], SafeProfile], words: str) -> None:
    assert words not in refusals(made(1 + OFF))
    assert words in refusals(made(1 - OFF))


def test_the_gain_that_is_claimed_is_the_one_of_the_loop() -> None:
    """By the poles of the sampled loop in many digits, of the weakest device of the box."""
    from tests.reference import crossings
    from tests.sampled_loops import Case, loop_along

    cup = tuned().elements["cup"]
    box = tuned().device.simultaneous_box()
    least = min(
        float(gain.mid())
        for mass in box.mass
        for damping in box.damping
        for gain in crossings(
            loop_along(
                Case(
                    mass=mass,
                    damping=damping,
                    sample_time=1e-3,
                    delay_samples=1.0,
                    velocity_filter_hz=50.0,
                    acceleration_filter_hz=30.0,
                ),
                None,
                cup.damping,
                cup.mass,
            )
        )
    )
    assert _edge_of_gain() == pytest.approx(least, rel=OFF)


def test_a_false_claim_of_delay_passivity_or_feeling_is_refused() -> None:
    assert "claimed delay margin" in refusals(margins(tuned(), "spring", extra_delay_samples=60.0))
    assert "claims passivity" in refusals(margins(tuned(), "wall", passive=True))
    asked = margins(tuned(), "cup", gain=2.0, extra_delay_samples=1.0)
    asked = with_element(asked, "cup", mass=tuned().elements["cup"].mass * 1.5)
    assert "steps from it" in refusals(asked)
    assert "steps from it" not in refusals(tuned())


def test_a_clamp_without_a_multiplier_is_refused() -> None:
    seal = tuned().certificate.model_copy(update={"absolute_stability": None})
    words = refusals(tuned().model_copy(update={"certificate": seal}))
    assert "wall + water: its force may be cut" in words


def test_a_wall_damps_more_than_its_lag_takes_and_keeps_to_its_lead() -> None:
    from tune.certificate.time_domain import contact_failures

    wall = tuned().elements["wall"]
    assert wall.lead is not None
    assert not [*contact_failures(tuned(), "wall")]
    for update, words in (
        ({"damping": 0.0025 * wall.stiffness * (1 - OFF)}, "less than the lag"),
        ({"lead": ((wall.contact and wall.contact.lead) or 0.0) * (1 - OFF)}, "before its face"),
    ):
        said = [*contact_failures(with_element(tuned(), "wall", **update), "wall")]
        assert any(words in each for each in said), said


def rewritten(path: Path, change: Callable[[dict[str, Any]], None], *, sign: bool = True) -> Path:
    content = to_mapping(tuned())
    content["digest"] = ""
    change(content)
    if sign:
        content["digest"] = digest_of(content)
    path.write_text(to_yaml(content, "forged"), encoding="utf-8")
    return path


def _set(*keys: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        place = content
        for key in keys[:-1]:
            place = place[key]
        if value is None:
            del place[keys[-1]]
        else:
            place[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("law", value=None), "an earlier law of walls"),
        (_set("law", value="gated"), "the law 'gated'"),
        (
            _set("elements", "wall", "margins", "absolute_gain", value=3.0),
            "margins.absolute_gain says 3.0",
        ),
        (_set("elements", "wall", "margins", "gain", value=2.6), "more than the"),
        (_set("certificate", "mass", value=[1.0, 2.0]), "certificate.mass says"),
        (_set("elements", "water", "limited_by", "damping", value="ripple"), "limited by ripple"),
        (_set("elements", "cup", "limited_by", "mass", value="stability"), "limited by stability"),
        (_set("elements", "cup", "limited_by", "mass", value="delay-margin"), "by delay-margin"),
        (_set("elements", "wall", "limited_by", "stiffness", value="rendering"), "by rendering"),
        (_set("elements", "spring", "limited_by", "damping", value="lead"), "limited by lead"),
        (_set("elements", "wall", "limited_by", "stiffness", value="saturation"), "by saturation"),
        (_set("elements", "water", "limited_by", value={}), "acts, limited_by says nothing"),
        (_set("elements", "water", "as_commanded", value=False), "says it is not"),
        (_set("elements", "water", "perceived_steps", value={}), "perceived_steps has nothing"),
        (_set("elements", "water", "margins", "gain", value=1.5), "margins.gain says 1.5"),
        (_set("elements", "water", "margins", "jitter", value=7.0), "margins.jitter says 7"),
        (_set("elements", "spring", "force_level", value=0.5), "force_level says 0.5"),
    ],
)
def test_check_refuses_every_false_word(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    with pytest.raises(CheckFailedError, match=words):
        check(rewritten(tmp_path / "profile.yaml", change))


def test_a_profile_without_its_digest_is_refused_and_the_true_one_is_not(tmp_path: Path) -> None:
    path = rewritten(tmp_path / "true.yaml", lambda _: None)
    assert check(path).profile.elements["wall"].stiffness == tuned().elements["wall"].stiffness
    with pytest.raises(CheckFailedError, match="digest"):
        check(rewritten(path, lambda _: None, sign=False))
