"""The source of the C guard as text; $-names are filled in from a profile by c_guard.py.

One file: the text of one C file.
"""

from __future__ import annotations

from tune.exporters.c_estimate import ESTIMATE

_HEAD = """\
${heading}
/*
 * The certified control law, T being the sample time. Of the axis, from every reading y:
 *
 *   d = (y[k] - y[k-1]) / T
 *   v = (tv v[k-1] - pv v[k-2]) + gv u,  u = (y[k] - y[k-n]) / (n T)
 *   a = (ta a[k-1] - pa a[k-2]) + ga u,  u = (d[k] - d[k-1]) / T
 *
 * Of each element F = -((K (y - rest) + B v) + M a); an element that pushes only gives none outside
 * its wall, and none that would pull. F is multiplied by the level to which the element is faded
 * in; then they are summed, multiplied by the gain, and cut at the peak force.
 *
 * A period without a good reading holds the force before it; the next good reading moves the
 * filters along the straight line between the two, and more than HAPTUNE_EXTRA_DELAY such periods
 * in a row end every contact. The certificate counts each as one sample of delay.
 */
#include "haptune_guard.h"

#include <math.h>

#ifdef __FAST_MATH__
#error "compile without -ffast-math: it takes out the test for NaN and reorders the filters"
#endif
#if HAPTUNE_PROFILE != ${tag}
#error "haptune_guard.h comes from another profile: export both again"
#endif

#define COUNT ${count}u
#define MOMENTS ${moment_count}u

typedef struct {
    double t, p, g;
} section;

typedef struct {
    double stiffness, damping, mass;
    int one_sided; /* 1: it pushes only */
    double fade;   /* change of its level in a period; 1 switches it at once */
} effects;

/* velocity: ${velocity_words} */
static const section velocity_filter = {${velocity}};
/* acceleration: ${acceleration_words} */
static const section acceleration_filter = {${acceleration}};

static const effects played[COUNT] = {
${played}};

static const uint64_t known = UINT64_C(${known});

/* Every set that is certified. */
static const uint64_t moments[MOMENTS] = {
${moments}};

/* ${force}: the peak force of the actuator. */
static const double peak_force = ${peak};

static uint64_t bit(unsigned index)
{
    return UINT64_C(1) << index;
}

static int certified(uint64_t elements)
{
    unsigned index;
    for (index = 0; index < MOMENTS; index++) {
        if (moments[index] == elements) {
            return 1;
        }
    }
    return elements == 0;
}

static int entered(const haptune_guard *guard, uint64_t elements)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        if ((elements & bit(index)) && !guard->contacts[index].entered) {
            return 0;
        }
    }
    return 1;
}
"""

_LAW = """\
static double no_force(haptune_guard *guard, haptune_status reason)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        guard->contacts[index].level = 0.0;
    }
    guard->status = reason;
    guard->force = 0.0;
    return guard->force;
}

static void end_contacts(haptune_guard *guard, uint64_t elements)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        if (elements & bit(index)) {
            guard->contacts[index].entered = 0;
            guard->contacts[index].level = 0.0;
        }
    }
}

static double force_of(const effects *effect, const haptune_contact *contact,
    const haptune_estimate *axis)
{
    const double force = -((effect->stiffness * (axis->last - contact->rest)
        + effect->damping * axis->velocity[0]) + effect->mass * axis->acceleration[0]);
    if (effect->one_sided
        && (!(contact->side * (contact->rest - axis->last) > 0.0) || contact->side * force < 0.0)) {
        return 0.0;
    }
    return force;
}

/* A level some periods later, on its way to 1 where the element is wanted and to 0 where not. */
static double faded(const effects *effect, double level, int wanted, uint32_t steps)
{
    const double change = effect->fade * steps;
    if (wanted) {
        return level + change < 1.0 ? level + change : 1.0;
    }
    return level > change ? level - change : 0.0;
}

/* Elements that give a force some periods later, if only these are wanted until then. */
static uint64_t acting(const haptune_guard *guard, uint64_t elements, uint32_t steps)
{
    unsigned index;
    uint64_t found = 0;
    for (index = 0; index < COUNT; index++) {
        const int wanted = (elements & bit(index)) != 0;
        if (faded(&played[index], guard->contacts[index].level, wanted, steps) > 0.0) {
            found |= bit(index);
        }
    }
    return found;
}

HAPTUNE_API void haptune_init(haptune_guard *guard)
{
    guard->status = HAPTUNE_OK;
    guard->clamped = 0;
    guard->missed = 0;
    guard->glitches = 0;
    guard->waiting = 0;
    guard->force = 0.0;
    start(&guard->axis, 0, 0.0, 0.0);
    guard->axis.started = 0;
    end_contacts(guard, UINT64_MAX);
}

HAPTUNE_API haptune_status haptune_reset(
    haptune_guard *guard, uint64_t elements, double rest, int side)
{
    unsigned index;
    haptune_contact *contact;
    guard->status = HAPTUNE_OK;
    if (elements & ~known) {
        guard->status = HAPTUNE_NOT_TOGETHER;
    } else if (!isfinite(rest)) {
        guard->status = HAPTUNE_NOT_FINITE;
    }
    for (index = 0; index < COUNT; index++) {
        if ((elements & bit(index)) && played[index].one_sided && side == 0) {
            guard->status = HAPTUNE_NO_SIDE;
        }
    }
    if (guard->status != HAPTUNE_OK) {
        end_contacts(guard, elements);
        return guard->status;
    }
    for (index = 0; index < COUNT; index++) {
        if (elements & bit(index)) {
            contact = &guard->contacts[index];
            contact->entered = 1;
            contact->side = (side > 0) - (side < 0);
            contact->rest = rest;
        }
    }
    return guard->status;
}

HAPTUNE_API double haptune_force(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain)
{
    unsigned index;
    double force = 0.0;
    const uint32_t steps = guard->axis.started ? period - guard->axis.period : 1;
    guard->clamped = 0;
    guard->status = read_position(guard, steps, period, position);
    if (guard->status == HAPTUNE_LATE) {
        end_contacts(guard, UINT64_MAX);
        return no_force(guard, HAPTUNE_LATE);
    }
    if (guard->status != HAPTUNE_OK) {
        return guard->force;
    }
    if (!certified(elements)) {
        return no_force(guard, HAPTUNE_NOT_TOGETHER);
    }
    if (!(gain >= 0.0 && gain <= 1.0)) {
        return no_force(guard, HAPTUNE_BAD_GAIN);
    }
    if (!entered(guard, elements)) {
        return no_force(guard, HAPTUNE_NOT_ENTERED);
    }
    if (!certified(acting(guard, elements, steps))) {
        elements &= acting(guard, 0, 0);
        guard->status = HAPTUNE_WAITING;
    }
    for (index = 0; index < COUNT; index++) {
        haptune_contact *contact = &guard->contacts[index];
        const int wanted = (elements & bit(index)) != 0;
        contact->level = faded(&played[index], contact->level, wanted, steps);
        if (contact->level > 0.0) {
            force += contact->level * force_of(&played[index], contact, &guard->axis);
        }
    }
    force *= gain;
    if (!isfinite(force)) {
        return no_force(guard, HAPTUNE_NOT_FINITE);
    }
    if (force > peak_force) {
        guard->clamped = 1;
        force = peak_force;
    } else if (force < -peak_force) {
        guard->clamped = 1;
        force = -peak_force;
    }
    guard->force = force;
    return force;
}
"""

SOURCE = f"{_HEAD}\n{ESTIMATE}\n{_LAW}"
