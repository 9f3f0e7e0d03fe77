"""A device in time, in doubles: its states, elements that are entered, steps that are uneven."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import product

import numpy as np

from tune.certificate.affine import FloatArray
from tune.certificate.poles import law_in_doubles
from tune.certificate.region import Region, Setting, regions_of, setting_of
from tune.documents.profile import Design, ElementProfile

#: Taylor terms of the exponential of a matrix below one half in norm: 2^-18/18! < 1e-20.
_TAYLOR = 18
#: A stated number has four digits; a restitution is rounded outwards.
_AGREE = 2e-3
#: Places between two samples at which an element is reached.
_PLACES = 8
#: Samples of half a period beyond which no bounce is stated, and of a device that stays inside.
_LONGEST, _STAYS = 5_000, 20_000
#: Parts of a sample of delay that count as none.
_WHOLE = 1e-9
#: Of a sample time, beyond which no jitter is looked at.
_MOST = 0.5
#: Steps looked at between the shortest and the longest, in parts of the jitter.
_LENGTHS = (-1.0, -0.5, 0.0, 0.5, 1.0)
#: A stated number has four digits and is found to a part in ten thousand.
_FOUND = 1e-3
#: Norms differ by less than this part of what even steps shrink: modes that are all but one are
#: told by rounding.
_ALIKE = 2.5e-3
#: Sweeps that balance moduli; what stands for none, in parts of the largest.
_SWEEPS, _NONE = 6, 1e-9


def state_space(region: Region, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(A, B, C) of positions, speeds and, with a lag, the force, from command to encoder."""
    mass, damping, _, _, lag, slope, *rest = values
    points = len(mass)
    hand = np.zeros((3, points))
    if region.hand is not None:
        hand = np.array(rest[:3])
        rest = rest[3:]
    encoder = np.array([1.0, *(mode.at_encoder for mode in region.modes)])
    handle = np.array([1.0, *(mode.at_handle for mode in region.modes)])
    count = len(encoder)
    grip = np.outer(handle, handle)
    diagonal = np.arange(count)
    inertia, loss, spring = (grip * part[:, None, None] for part in hand)
    inertia[:, diagonal, diagonal] += mass[:, None]
    loss[:, 0, 0] += damping
    spring[:, 0, 0] += slope
    for i in range(count - 1):
        omega = 2 * np.pi * rest[2 * i]
        loss[:, i + 1, i + 1] += 2 * rest[2 * i + 1] * omega * mass
        spring[:, i + 1, i + 1] += omega**2 * mass
    inverse = np.linalg.inv(inertia)
    lagged = region.current_lag[1] > 0
    size = 2 * count + lagged
    motion, drive = np.zeros((points, size, size)), np.zeros((points, size))
    motion[:, diagonal, count + diagonal] = 1.0
    motion[:, count : 2 * count, :count] = -inverse @ spring
    motion[:, count : 2 * count, count : 2 * count] = -inverse @ loss
    force = inverse @ encoder
    if lagged:
        motion[:, count : 2 * count, -1] = force
        motion[:, -1, -1] = -1 / lag
        drive[:, -1] = 1 / lag
    else:
        drive[:, count:] = force
    return motion, drive, np.pad(encoder, (0, size - count))


def held_motion(
    motion: FloatArray, drive: FloatArray, time: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(Φ, Γ) of x after a time of constant force F, Φ·x + Γ·F, for a stack of (A, B)."""
    size = motion.shape[-1]
    matrix = np.zeros((len(motion), size + 1, size + 1))
    matrix[:, :size, :size] = motion
    matrix[:, :size, size] = drive
    matrix = matrix * np.asarray(time)[..., None, None]
    # The exponential of a matrix, by scaling and squaring; times are of shape (..., stack).
    norm = np.abs(matrix).sum(axis=-1).max(initial=0.5)
    halvings = max(0, int(np.ceil(np.log2(2 * norm))))
    scaled = matrix / 2.0**halvings
    term = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape).copy()
    total = term.copy()
    for order in range(1, _TAYLOR):
        term = term @ scaled / order
        total += term
    for _ in range(halvings):
        total = total @ total
    return total[..., :size, :size], total[..., :size, size]


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
    claimed: dict[str, float | None] = {key: getattr(said, key) for key in seen}
    found = _restitution(design, name, element, region)
    for place, key in enumerate(("restitution (least)", "restitution (largest)")):
        claimed[key] = None if said.restitution is None else said.restitution[place]
        seen[key] = None if found is None else found[place]
    # Differences of larger numbers have the digits that these leave them.
    size = {"net_damping": 2 * abs(B) + abs(net or 0.0)}
    size["lead"] = speed * size["net_damping"] / K if K else 0.0
    size |= {"restitution (least)": 1.0, "restitution (largest)": 1.0}
    for key, value in seen.items():
        stated = claimed[key]
        alike = stated is value
        if stated is not None and value is not None:
            alike = abs(stated - value) <= _AGREE * (size.get(key) or abs(value))
        if not alike:
            said_so, seen_so = four_digits(stated), four_digits(value)
            yield f"{name}: contact.{key} says {said_so}, computed anew it is {seen_so}"
    most = element.lead
    if (most is not None) != element.one_sided:
        yield f"{name}: lead is stated of walls, of each of them"
    # As wanted, or a wanted value of which there is less, of which a note tells.
    served = element.limited_by.get("damping") not in {None, "wanted", "not-perceptible"}
    served &= not any(note.startswith(f"{name}.damping: ") for note in design.notes)
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
            for columns in _corners(region)
        ]
    )
    if not np.isfinite(bounces).all():
        return None
    beside = float(np.max(np.abs(bounces[:, 1:] - bounces[:, :-1])))
    return max(0.0, float(bounces.min()) - beside), float(bounces.max()) + beside


def _corners(region: Region) -> Iterator[list[list[float]]]:
    """Corners by sample time and delay, rows as in `Region.sides`; modes at ends and middle."""
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
    whole, part = _split(float(values[3, 0]) / step)
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
    sections, lead = _sections(setting, step)
    kept = [(np.ones_like(now), np.ones_like(now))] * len(sections)
    sent = [np.zeros_like(now)] * (whole + 2)
    outside = np.zeros(now.shape, dtype=np.intp)
    speed = np.zeros_like(now)
    for _ in range(_STAYS + len(sent)):
        now = x @ read
        slope = (now - readings[window - 1]) / (window * step)
        estimate = slope
        for place, (t, p) in enumerate(sections):
            latest, before = kept[place]
            estimate = t * latest - p * before + (1 - t + p) * estimate
            kept[place] = estimate, latest
        if lead:
            estimate = estimate + lead * (estimate - kept[-1][1])
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


def _split(late: float) -> tuple[int, float]:
    """Whole samples of a delay, and the part of one that is left."""
    whole = math.floor(late + _WHOLE)
    return whole, late - whole if late - whole > _WHOLE else 0.0


def _moved(held: tuple[FloatArray, FloatArray], x: FloatArray, force: FloatArray) -> FloatArray:
    """States after a part of a step under a constant force."""
    transition, drive = held
    return x @ transition.swapaxes(-1, -2) + drive[:, None, :] * force[..., None]


def _sections(setting: Setting, step: float) -> tuple[list[tuple[float, float]], float]:
    """((t, p) of sections t·v - p·v' + (1 - t + p)·slope in a row, lead in samples) of velocity."""
    hertz, order, carried = setting.estimate(1)
    if not setting.damping or hertz is None:
        return [], 0.0
    turn, ratio = 2 * math.pi * hertz * step, setting.filter_damping_ratio
    a, pole = math.exp(-turn), math.exp(-turn * ratio)
    pair = 2 * pole * math.cos(turn * math.sqrt(1 - ratio * ratio)), pole * pole
    sections = [(a, 0.0)] if order == 1 else [pair, *[(a, 0.0)] * (order - 2)]
    lag = sum((t - 2 * p) / (1 - t + p) for t, p in sections) + 0.5
    return sections, lag if carried else 0.0


def four_digits(value: float | None) -> str:
    """A number for people."""
    return "nothing" if value is None else f"{value:.4g}"


def jitter_failures(design: Design, name: str) -> Iterator[str]:
    """A jitter that is not the least over corners of the box and combinations of an element."""
    said = design.elements[name].margins.jitter
    if said is None:
        yield f"{name}: margins.jitter is missing. Tune again"
        return
    if not 0 <= said <= _MOST:
        yield f"{name}: margins.jitter says {said:.4g}, it lies within 0 to {_MOST:g}"
        return
    region = regions_of(design)[0]
    settings = (
        setting_of(design, combination)
        for combination in design.combinations()
        if name in combination
    )
    corners = [np.array(corner) for alike in _corners(region) for corner in alike]
    loops = [(each, values) for each in settings if each is not None for values in corners]

    def shrinks(jitter: float, way: int) -> bool:
        """Whether the norm of every loop shrinks under all steps, or all but grows or shrinks."""
        norms = (_largest_norm(region, *loop, jitter) for loop in loops)
        return all(norm < 1 + way * _ALIKE * (1 - even) for norm, even in norms)

    if said > 0 and not shrinks(said * (1 - _FOUND), 1):
        yield f"{name}: margins.jitter says {said:.4g}, computed anew it is less"
    elif said < _MOST and shrinks(max(said, _FOUND) * (1 + _FOUND), -1):
        yield f"{name}: margins.jitter says {said:.4g}, computed anew it is more"


def _largest_norm(
    region: Region, setting: Setting, values: FloatArray, jitter: float
) -> tuple[float, float]:
    """Norm of the modes under the worst step, and under an even one."""
    transitions = _transitions(region, setting, values, 1 + jitter * np.array(_LENGTHS))
    even = transitions[_LENGTHS.index(0.0)]
    poles, modes = np.linalg.eig(even)
    # An even step is its poles; products with modes that are all but one would lose them.
    seen = np.diag(poles) + np.linalg.inv(modes) @ (transitions - even) @ modes
    if not setting.stiffness and not region.grounded:
        free = int(np.argmin(np.abs(poles - 1)))
        seen = np.delete(np.delete(seen, free, axis=1), free, axis=2)
    moduli = np.max(np.abs(seen), axis=0)
    scale = np.ones(len(moduli))
    others = moduli - np.diag(np.diag(moduli)) + np.finfo(float).tiny
    for _ in range(_SWEEPS):
        scaled = others * np.divide.outer(scale, scale)
        scale *= np.sqrt(np.sqrt(scaled.sum(axis=0) / scaled.sum(axis=1)))
        scale /= scale.max()
    scaled = moduli * np.divide.outer(scale, scale)
    scaled = scaled + _NONE * scaled.max()
    scale *= np.sqrt(_principal(scaled.T) / _principal(scaled))
    norms = np.linalg.norm(seen * np.divide.outer(scale, scale), 2, axis=(1, 2))
    return float(np.max(norms)), float(norms[_LENGTHS.index(0.0)])


def _principal(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eig(matrix)
    return np.abs(vectors[:, int(np.argmax(np.real(values)))])


def _transitions(
    region: Region, setting: Setting, values: FloatArray, lengths: FloatArray
) -> FloatArray:
    """States (mechanism, commands under way, law) after one step of so many sample times each."""
    motion, drive, read = state_space(region, np.repeat(values[:, None], len(lengths), axis=1))
    step = float(values[2])
    whole, part = _split(float(values[3]) / step)
    update, enter, leave, through = _law(setting, step)
    n, law = len(read), len(enter)
    under_way = whole + (part > 0)
    size = n + under_way + law
    # The newest command, in terms of the states.
    newest = np.zeros(size)
    newest[:n] = through * read
    newest[n + under_way :] = leave
    commands = np.vstack([newest, np.eye(size)[n : n + under_way]])
    moved = np.repeat(np.eye(size)[None, :n], len(lengths), axis=0)
    if part:
        free, pushed = held_motion(motion, drive, part * step * lengths)
        moved = free @ moved + pushed[:, :, None] * commands[whole + 1]
    free, pushed = held_motion(motion, drive, (1 - part) * step * lengths)
    moved = free @ moved + pushed[:, :, None] * commands[whole]
    remembered = np.zeros((law, size))
    remembered[:, n + under_way :] = update
    remembered[:, :n] = np.outer(enter, read)
    below = np.vstack([commands[:under_way], remembered])
    return np.hstack([moved, np.repeat(below[None], len(lengths), axis=0)])


@lru_cache(maxsize=256)
def _law(setting: Setting, step: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """(A, B, C, D) of the force, -(law), in controllable form."""
    top, bottom, vanishes = law_in_doubles(setting, step)
    if vanishes:
        top = np.append(top, 0.0) - np.append(0.0, top)
    above = -np.append(np.zeros(len(bottom) - len(top)), top) / bottom[0]
    below = bottom / bottom[0]
    while len(below) > 1 and below[-1] == 0 and above[-1] == 0:
        below, above = below[:-1], above[:-1]
    order = len(below) - 1
    update = np.eye(order, k=-1)
    if order:
        update[0] = -below[1:]
    return update, np.eye(order, 1)[:, 0], above[1:] - above[0] * below[1:], float(above[0])
