"""The part of the C guard that turns readings into velocity and acceleration, as text."""

from __future__ import annotations

ESTIMATE = """\
static void run_section(const section *filter, double *state, double input)
{
    const double output = (filter->t * state[0] - filter->p * state[1]) + filter->g * input;
    state[1] = state[0];
    state[0] = output;
}

/* As if the device had moved at this slope until now. */
static void start(haptune_estimate *axis, uint32_t period, double position, double slope)
{
    unsigned place;
    axis->started = 1;
    axis->period = period;
    axis->oldest = 0;
    for (place = 0; place < HAPTUNE_WINDOW; place++) {
        axis->past[place] = position - (HAPTUNE_WINDOW - 1 - place) * slope * HAPTUNE_SAMPLE_TIME;
    }
    axis->last = position;
    axis->slope = slope;
    axis->earlier = position - slope * HAPTUNE_SAMPLE_TIME;
    axis->earlier_slope = slope;
    axis->velocity[0] = slope;
    axis->velocity[1] = slope;
    axis->acceleration[0] = 0.0;
    axis->acceleration[1] = 0.0;
}

static void take(haptune_estimate *axis, double position)
{
    const double slope = (position - axis->last) / HAPTUNE_SAMPLE_TIME;
    const double mean = (position - axis->past[axis->oldest])
        / (HAPTUNE_WINDOW * HAPTUNE_SAMPLE_TIME);
    run_section(&velocity_filter, axis->velocity, mean);
    run_section(&acceleration_filter, axis->acceleration,
        (slope - axis->slope) / HAPTUNE_SAMPLE_TIME);
    axis->past[axis->oldest] = position;
    axis->oldest = (axis->oldest + 1) % HAPTUNE_WINDOW;
    axis->earlier = axis->last;
    axis->earlier_slope = axis->slope;
    axis->last = position;
    axis->slope = slope;
}

/* Along the straight line to a reading that is some periods after the last one. */
static void bridge(haptune_estimate *axis, uint32_t steps, double position)
{
    const double before = axis->last;
    uint32_t step;
    for (step = 1; step < steps; step++) {
        take(axis, before + (position - before) * step / steps);
    }
    take(axis, position);
    axis->period += steps;
}

/* Whether a device that went on straight could be there: from the last reading, or, should that
 * have been a small jump itself, from the one before. */
static int plausible(const haptune_estimate *axis, uint32_t steps, double position)
{
    const double later = HAPTUNE_SAMPLE_TIME * steps;
    const double line = axis->last + axis->slope * later;
    const double earlier_line = axis->earlier
        + axis->earlier_slope * (later + HAPTUNE_SAMPLE_TIME);
    const double most = HAPTUNE_LARGEST_CHANGE * steps;
    return fabs(position - line) <= most || fabs(position - earlier_line) <= most;
}

/* Uses a reading; where it is not HAPTUNE_OK, the reading was not used for any force. */
static haptune_status read_position(
    haptune_guard *guard, uint32_t steps, uint32_t period, double position)
{
    haptune_estimate *axis = &guard->axis;
    haptune_status fault = HAPTUNE_OK;
    if (!isfinite(position)) {
        fault = HAPTUNE_NOT_FINITE;
    } else if (!axis->started) {
        start(axis, period, position, 0.0);
    } else if (steps == 0) {
        fault = HAPTUNE_STALE;
    } else if (steps - 1 > HAPTUNE_EXTRA_DELAY) {
        start(axis, period, position, (position - axis->last) / (HAPTUNE_SAMPLE_TIME * steps));
        guard->waiting = 0;
        return HAPTUNE_LATE;
    } else if (!plausible(axis, steps, position)) {
        fault = HAPTUNE_GLITCH;
        guard->glitches++;
    } else {
        bridge(axis, steps, position);
        guard->missed += steps - 1;
    }
    if (fault == HAPTUNE_OK) {
        guard->waiting = 0;
        return fault;
    }
    guard->waiting++;
    if (axis->started && (guard->waiting > HAPTUNE_EXTRA_DELAY || steps > HAPTUNE_EXTRA_DELAY)) {
        return HAPTUNE_LATE;
    }
    return fault;
}
"""
