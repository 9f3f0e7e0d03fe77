"""Contact numbers of a profile, followed sample by sample and compared with what it says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from tune.certificate.affine import FloatArray
from tune.certificate.point import Setting, setting_of
from tune.certificate.region import Region, regions_of
from tune.certificate.sampled_loops import held_motion, state_space
from tune.documents.profile import Design, ElementProfile

#: A stated number has four digits; a restitution is rounded outwards.
_AGREE = 2e-3
#: Places between two samples at which an element is reached.
_PLACES = 8
#: Samples of half a period beyond which no bounce is stated, and of a device that stays inside.
_LONGEST, _STAYS = 5_000, 20_000
#: Parts of a sample of delay that count as none.
_WHOLE = 1e-9


def contact_failures(design: Design, name: str) -> Iterator[str]:
    """Numbers about entering an element that are not those of the device and the law."""
    element = design.elements[name]
    said = element.contact
    if said is None:
        yield f"{name}: contact is missing. Tune again"
        return
    region, limit = regions_of(design)[0], design.device.force_limit
    K, B, M = element.stiffness, element.damping, element.mass
    speed, level = element.motion.speed, element.force_level
    net, lead = lead_of(design, name) if K else (None, None)
    shallow = None if limit is None or not K else min(limit.continuous, level) / K
    seen = {
        "depth_at_continuous_force": shallow,
        "depth_at_peak_force": None if limit is None or not K else level / K,
        "force_on_entry": speed * (K * region.sample_time[1] if K else abs(B)),
        "energy_per_entry": abs(M) * speed * speed / 2 if M else None,
        "net_damping": net,
        "lead": lead,
    }
    pairs = [(key, getattr(said, key), value) for key, value in seen.items()]
    found = _restitution(design, name, element, region)
    for place, which in enumerate(("least", "largest")):
        pairs.append(
            (
                f"restitution ({which})",
                None if said.restitution is None else said.restitution[place],
                None if found is None else found[place],
            )
        )
    # Differences of larger numbers have the digits that these leave them.
    size = {"net_damping": 2 * abs(B) + abs(net or 0.0)}
    size["lead"] = speed * size["net_damping"] / K if K else 0.0
    for key, stated, value in pairs:
        if (stated is None) != (value is None) or (
            stated is not None
            and value is not None
            and not abs(stated - value) <= _AGREE * (size.get(key) or abs(value))
        ):
            yield f"{name}: contact.{key} says {_number(stated)}, computed anew it is " + _number(
                value
            )
    most = element.lead
    if (most is not None) != element.one_sided:
        yield f"{name}: lead is stated of walls, of each of them"
    served = element.limited_by.get("damping") not in {None, "wanted", "not-perceptible"}
    if most is not None and K and B and served:
        least, lead = lead_of(design, name)
        if least < -_AGREE * B:
            yield (
                f"{name}: its damping of {B:.6g} is less than the lag of its spring takes, net "
                f"{least:.4g}. Tune again"
            )
        if lead > most * (1 + _AGREE):
            yield (
                f"{name}: at {speed:g} it is met {lead:.4g} before its face, {most:.4g} is allowed"
            )


def lead_of(design: Design, name: str) -> tuple[float, float]:
    """(net damping at its least, N·s/m, how far before its place it is met, m) of an element."""
    element, region, device = design.elements[name], regions_of(design)[0], design.device
    latest = region.sample_time[1] * (design.margin.extra_delay_samples + 0.5) + region.delay[1]
    usual = device.sample_time.value / 2 + device.delay.value
    usual += 0.0 if device.current_lag is None else device.current_lag.value
    K, B = element.stiffness, element.damping
    return B - K * (latest + region.current_lag[1]), (B / K - usual) * element.motion.speed


def _restitution(
    design: Design, name: str, element: ElementProfile, region: Region
) -> tuple[float, float] | None:
    """Least and largest over corners and places, widened by the largest step between places."""
    K, B, M = element.stiffness, element.damping, element.mass
    setting = setting_of(design, (name,))
    half = math.pi * math.sqrt(region.mass[1] / K) if K else math.inf
    if setting is None or M or B < 0 or half > _LONGEST * region.sample_time[0]:
        return None
    bounces: FloatArray = np.concatenate(
        [
            _bounces(region, setting, np.array(columns).T, one_sided=element.one_sided)
            for columns in _alike(region)
        ]
    )
    if not np.isfinite(bounces).all():
        return None
    beside = float(np.max(np.abs(bounces[:, 1:] - bounces[:, :-1])))
    return max(0.0, float(bounces.min()) - beside), float(bounces.max()) + beside


def _alike(region: Region) -> Iterator[list[list[float]]]:
    """Corners, rows as in `Region.sides`, by sample time and delay.

    Modes are at their least, middle and largest, all of them together.
    """
    mass, damping, step, delay, lag, slope, *modes = region.sides()
    parts = (0.0, 0.5, 1.0) if any(low != high for low, high in modes) else (0.0,)
    for T, late in product(sorted({*step}), sorted({*delay})):
        yield [
            [m, b, T, late, tau, k, *((1 - part) * low + part * high for low, high in modes)]
            for m, b, tau, k in product(*({*side} for side in (mass, damping, lag, slope)))
            for part in parts
        ]


def _bounces(
    region: Region, setting: Setting, values: FloatArray, *, one_sided: bool
) -> FloatArray:
    """Speed out over speed in, shape (devices, places), of devices of one sample time and delay."""
    motion, drive, read = state_space(region, values)
    mass, damping, step, lag = values[0], values[1], float(values[2, 0]), values[4]
    late = float(values[3, 0]) / step
    whole = math.floor(late + _WHOLE)
    part = late - whole if late - whole > _WHOLE else 0.0
    places = np.arange(1, _PLACES + 1) / _PLACES
    # At unit speed the law passes zero so far before the place.
    ahead = setting.damping / setting.stiffness
    rigid = len(region.modes) + 1
    x = np.stack([held_motion(motion, drive, t * step)[0][:, :, rigid] for t in places], axis=1)
    first = held_motion(motion, drive, part * step)
    last = held_motion(motion, drive, (1 - part) * step)
    window = (setting.velocity_window_samples or 1) if setting.damping else 1
    x[..., 0] -= ahead
    under_way = whole + (part > 0)
    now = x @ read
    readings = [now - (back + 1) * step for back in range(window)]
    estimate, before = np.ones_like(now), np.ones_like(now)
    t, p = _filter(setting, step)
    sent = [np.zeros_like(now)] * (whole + 2)
    outside = np.zeros(now.shape, dtype=np.intp)
    speed = np.zeros_like(now)
    for _ in range(_STAYS + len(sent)):
        now = x @ read
        slope = (now - readings[window - 1]) / (window * step)
        estimate, before = t * estimate - p * before + (1 - t + p) * slope, estimate
        readings = [now, *readings[:-1]]
        force = np.minimum(-(setting.stiffness * now + setting.damping * estimate), 0.0)
        # A wall is left where the device is outside of it, another element as soon as it pulls.
        outside += (outside > 0) | ((force == 0) & ((now <= 0) | (not one_sided)))
        sent = [np.where(outside > 0, 0.0, force), *sent[:-1]]
        # What free motion does not change: momentum over mass, at the place of entry.
        leaving = x[..., rigid] + (damping / mass)[:, None] * (x[..., 0] + ahead)
        if region.current_lag[1] > 0:
            leaving = leaving + (lag / mass)[:, None] * x[..., -1]
        speed = np.where(outside == under_way + 1, np.maximum(0.0, -leaving), speed)
        if (outside > under_way).all():
            break
        if part:
            x = _moved(first, x, sent[whole + 1])
        x = _moved(last, x, sent[whole])
    return speed


def _moved(held: tuple[FloatArray, FloatArray], x: FloatArray, force: FloatArray) -> FloatArray:
    """States after a part of a step under a constant force."""
    transition, drive = held
    return x @ transition.swapaxes(-1, -2) + drive[:, None, :] * force[..., None]


def _filter(setting: Setting, step: float) -> tuple[float, float]:
    """(t, p) of the filtered velocity, t·v - p·v' + (1 - t + p)·slope; none for none."""
    if not setting.damping or setting.velocity_filter_hz is None:
        return 0.0, 0.0
    turn = 2 * math.pi * setting.velocity_filter_hz * step
    if setting.velocity_filter_order == 1:
        return math.exp(-turn), 0.0
    ratio = setting.filter_damping_ratio
    pole = math.exp(-turn * ratio)
    return 2 * pole * math.cos(turn * math.sqrt(1 - ratio * ratio)), pole * pole


def _number(value: float | None) -> str:
    return "nothing" if value is None else f"{value:.4g}"
