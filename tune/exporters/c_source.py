"""The source of the C guard as text; $-names are filled in from a profile by c_guard.py."""

from __future__ import annotations

SOURCE = """\
${heading}
/*
 * The certified control law, evaluated in this order for each element, T the sample time:
 *
 *   d = (y[k] - y[k-1]) / T
 *   v = (tv v[k-1] - pv v[k-2]) + gv u,  u = (y[k] - y[k-n]) / (n T)
 *   a = (ta a[k-1] - pa a[k-2]) + ga u,  u = (d[k] - d[k-1]) / T
 *   F = -((K (y - rest) + B v) + M a)
 *
 * summed over the elements, multiplied by the gain, cut at the peak force. A period without a good
 * reading gives no force; the next good one moves the filters along the straight line between the
 * two, and more than HAPTUNE_EXTRA_DELAY such periods in a row end the contact. The certificate
 * counts each as one sample of delay.
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
    return 0;
}

static void end_contacts(haptune_guard *guard, uint64_t elements)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        if (elements & bit(index)) {
            guard->contacts[index].entered = 0;
        }
    }
}

/* Why there is no force this time; HAPTUNE_OK where there is one. */
static haptune_status examine(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain)
{
    unsigned index;
    uint32_t steps;
    uint32_t longest = 1;
    if (!certified(elements)) {
        return HAPTUNE_NOT_TOGETHER;
    }
    if (!(gain >= 0.0 && gain <= 1.0)) {
        return HAPTUNE_BAD_GAIN;
    }
    if (!isfinite(position)) {
        return HAPTUNE_NOT_FINITE;
    }
    for (index = 0; index < COUNT; index++) {
        if (!(elements & bit(index))) {
            continue;
        }
        if (!guard->contacts[index].entered) {
            return HAPTUNE_NOT_ENTERED;
        }
        steps = period - guard->contacts[index].period;
        if (steps == 0) {
            return HAPTUNE_STALE;
        }
        longest = steps > longest ? steps : longest;
    }
    if (longest - 1 > HAPTUNE_EXTRA_DELAY) {
        end_contacts(guard, elements);
        return HAPTUNE_LATE;
    }
    guard->missed += longest - 1;
    return HAPTUNE_OK;
}

static void run_section(const section *filter, double *state, double input)
{
    const double output = (filter->t * state[0] - filter->p * state[1]) + filter->g * input;
    state[1] = state[0];
    state[0] = output;
}

static void read_position(haptune_contact *contact, double position)
{
    const double slope = (position - contact->last) / HAPTUNE_SAMPLE_TIME;
    const double mean = (position - contact->past[contact->oldest])
        / (HAPTUNE_WINDOW * HAPTUNE_SAMPLE_TIME);
    run_section(&velocity_filter, contact->velocity, mean);
    run_section(&acceleration_filter, contact->acceleration,
        (slope - contact->slope) / HAPTUNE_SAMPLE_TIME);
    contact->past[contact->oldest] = position;
    contact->oldest = (contact->oldest + 1) % HAPTUNE_WINDOW;
    contact->last = position;
    contact->slope = slope;
}

static double pull(
    const effects *effect, haptune_contact *contact, uint32_t period, double position)
{
    const double before = contact->last;
    const uint32_t steps = period - contact->period;
    uint32_t step;
    for (step = 1; step < steps; step++) {
        read_position(contact, before + (position - before) * step / steps);
    }
    read_position(contact, position);
    contact->period = period;
    return -((effect->stiffness * (position - contact->rest)
        + effect->damping * contact->velocity[0]) + effect->mass * contact->acceleration[0]);
}

HAPTUNE_API void haptune_init(haptune_guard *guard)
{
    guard->status = HAPTUNE_OK;
    guard->clamped = 0;
    guard->missed = 0;
    end_contacts(guard, UINT64_MAX);
}

HAPTUNE_API haptune_status haptune_reset(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double rest)
{
    unsigned index;
    unsigned place;
    haptune_contact *contact;
    end_contacts(guard, elements);
    if (elements & ~known) {
        guard->status = HAPTUNE_NOT_TOGETHER;
        return guard->status;
    }
    if (!isfinite(position) || !isfinite(rest)) {
        guard->status = HAPTUNE_NOT_FINITE;
        return guard->status;
    }
    for (index = 0; index < COUNT; index++) {
        if (!(elements & bit(index))) {
            continue;
        }
        contact = &guard->contacts[index];
        contact->entered = 1;
        contact->period = period - 1u;
        contact->oldest = 0;
        for (place = 0; place < HAPTUNE_WINDOW; place++) {
            contact->past[place] = position;
        }
        contact->last = position;
        contact->slope = 0.0;
        contact->velocity[0] = contact->velocity[1] = 0.0;
        contact->acceleration[0] = contact->acceleration[1] = 0.0;
        contact->rest = rest;
    }
    guard->status = HAPTUNE_OK;
    return guard->status;
}

HAPTUNE_API double haptune_force(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain)
{
    unsigned index;
    double force = 0.0;
    guard->clamped = 0;
    guard->status = HAPTUNE_OK;
    if (elements == 0) {
        return 0.0;
    }
    guard->status = examine(guard, elements, period, position, gain);
    if (guard->status != HAPTUNE_OK) {
        return 0.0;
    }
    for (index = 0; index < COUNT; index++) {
        if (elements & bit(index)) {
            force += pull(&played[index], &guard->contacts[index], period, position);
        }
    }
    force *= gain;
    if (!isfinite(force)) {
        end_contacts(guard, elements);
        guard->status = HAPTUNE_NOT_FINITE;
        return 0.0;
    }
    if (force > peak_force || force < -peak_force) {
        force = force > 0.0 ? peak_force : -peak_force;
        guard->clamped = 1;
    }
    return force;
}
"""
