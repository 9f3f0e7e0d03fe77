${heading}
/*
 * The certified control law, T being the sample time. Of the axis, from every reading y:
 *
 *   d = (y[k] - y[k-1]) / T
 *   v from u = (y[k] - y[k-n]) / (n T),  a from u = (d[k] - d[k-1]) / T
 *
 * each through two sections x[k] = (t x[k-1] - p x[k-2]) + g u[k], one after the other, and from the
 * last x + lead (x - x[k-1]). Where two x in a row are below 1e-30, both are 0, else a device that
 * stands still would never be quiet.
 *
 * Of each element u = (K (y - rest) + B v) + M a and F = -level u. With a spring, u is clamped to
 * its force level, and of a wall to the side to which it pushes: it never pulls. The forces are
 * summed and cut at the peak force.
 *
 * Level is the gain of what is wanted and 0 of what is not. What has to fade gets there slowly, and
 * not while a wall pushes. All else falls there at once; a spring rises only as it is entered, or
 * after HAPTUNE_TAPS samples without force. A spring that is entered rests where the device is, a
 * wall only if that is behind its face; a wall stands at its face again after HAPTUNE_TAPS samples
 * without force there.
 *
 * A period without a good reading holds the force before it; the next good reading moves the
 * filters along the straight line between the two, and more than HAPTUNE_EXTRA_DELAY such periods
 * in a row end every contact. The certificate counts each as one sample of delay.
 *
 * haptune_law.py of the same profile gives the same forces to the last bit, unless a compiler fuses
 * multiplications and additions: -ffp-contract=off, which -std=c99 of GCC implies, keeps it from that.
 */
#include "haptune_guard.h"

#include <math.h>
#include <string.h>

#if HAPTUNE_PROFILE != ${tag}
#error "haptune_guard.h comes from another profile: export both again"
#endif

#define COUNT ${count}u
#define COMBINATIONS ${combination_count}u
/* m/s or m/s^2 (rad): far below the rounding of any reading. */
#define VANISHED 1e-30

typedef struct {
    struct {
        double t, p, g;
    } sections[2];
    double lead; /* samples */
} filter;

typedef struct {
    double stiffness, damping, mass;
    double force_level; /* the most its spring, with all beside it, may give */
    double lead_time;   /* by which its damper is before its spring, B / K */
    double speed;       /* with which it is met */
    int one_sided;      /* 1: it pushes only */
    double fade;        /* change of its level in a period; 1 switches it at once */
} effects;

/* velocity: ${velocity_words} */
static const filter velocity_filter = {${velocity}};
/* acceleration: ${acceleration_words} */
static const filter acceleration_filter = {${acceleration}};

static const effects played[COUNT] = {
${played}};

static const uint64_t known = UINT64_C(${known});
static const uint64_t walls = UINT64_C(${walls});

/* Every set that is certified, in rising order. */
static const uint64_t combinations[COMBINATIONS] = {
${combinations}};

/* ${force}: the peak force of the actuator. */
static const double peak_force = ${peak};

/* Whether a number is finite and below 2^64, so that nothing made of it overflows or is NaN. Asked of
 * the exponent's bits, before anything is computed: flags may let a compiler assume that a double is
 * finite, which it then need not compare. It can assume nothing of what is volatile. */
static int usable(double number)
{
    volatile union {
        double number;
        uint64_t bits;
    } seen;
    seen.number = number;
    return (seen.bits >> 52 & 0x7ffu) < 1023u + 64u;
}

static uint64_t bit(unsigned index)
{
    return UINT64_C(1) << index;
}

static int certified(uint64_t elements)
{
    unsigned low = 0, high = COMBINATIONS;
    while (low < high) {
        const unsigned middle = (low + high) / 2;
        if (combinations[middle] < elements) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return elements == 0 || (low < COMBINATIONS && combinations[low] == elements);
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

static double run(const filter *by, double state[2][2], double input)
{
    double output = input;
    int place;
    for (place = 0; place < 2; place++) {
        output = (by->sections[place].t * state[place][0] - by->sections[place].p * state[place][1])
            + by->sections[place].g * output;
        state[place][1] = state[place][0];
        if (fabs(output) < VANISHED && fabs(state[place][1]) < VANISHED) {
            output = state[place][1] = 0.0;
        }
        state[place][0] = output;
    }
    return output + by->lead * (output - state[1][1]);
}

/* As if the device had moved at this slope until now. */
static void start(haptune_estimate *axis, uint32_t period, double position, double slope)
{
    unsigned place, index;
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
    for (place = 0; place < 2; place++) {
        for (index = 0; index < 2; index++) {
            axis->of_velocity[place][index] = slope;
            axis->of_acceleration[place][index] = 0.0;
        }
    }
    axis->velocity = slope;
    axis->acceleration = 0.0;
}

static void take(haptune_estimate *axis, double position)
{
    const double slope = (position - axis->last) / HAPTUNE_SAMPLE_TIME;
    const double mean = (position - axis->past[axis->oldest])
        / (HAPTUNE_WINDOW * HAPTUNE_SAMPLE_TIME);
    axis->velocity = run(&velocity_filter, axis->of_velocity, mean);
    axis->acceleration = run(&acceleration_filter, axis->of_acceleration,
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
    if (!usable(position)) {
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

/* Whether two walls that push towards each other are neither one clamp nor clear of the other. */
static int narrow(const effects *one, const effects *other, double room)
{
    const double here = one->lead_time, there = other->lead_time;
    const double lead = fabs(here - there) <= 1e-9 * (here > there ? here : there)
        ? 0.0 : here * one->speed + there * other->speed;
    return !(room >= lead);
}

/* Whether a wall at some face leaves too little room to one of others on the opposite side. */
static int crowded(
    const haptune_guard *guard, unsigned wall, double face, int side, uint64_t others)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        const haptune_contact *contact = &guard->contacts[index];
        if ((others & walls & bit(index)) && contact->side == -side
            && narrow(&played[wall], &played[index], side * (contact->face - face))) {
            return 1;
        }
    }
    return 0;
}

/* Whether elements may act at once: with the walls of either side alone, if there is room. */
static haptune_status together(const haptune_guard *guard, uint64_t elements)
{
    unsigned index;
    uint64_t below = 0, above = 0;
    for (index = 0; index < COUNT; index++) {
        if (elements & walls & bit(index)) {
            below |= guard->contacts[index].side > 0 ? bit(index) : 0;
            above |= guard->contacts[index].side < 0 ? bit(index) : 0;
        }
    }
    if (!certified(elements & ~below) || !certified(elements & ~above)) {
        return HAPTUNE_NOT_TOGETHER;
    }
    for (index = 0; index < COUNT; index++) {
        if ((below & bit(index))
            && crowded(guard, index, guard->contacts[index].face, 1, above)) {
            return HAPTUNE_TOO_NARROW;
        }
    }
    return HAPTUNE_OK;
}

static double no_force(haptune_guard *guard, haptune_status reason)
{
    unsigned index;
    for (index = 0; index < COUNT; index++) {
        guard->contacts[index].wanted = 0;
        guard->contacts[index].level = 0.0;
        guard->contacts[index].force = 0.0;
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
            memset(&guard->contacts[index], 0, sizeof guard->contacts[index]);
        }
    }
}

/* u of an element that rests there; what is no number stays none. */
static double clamped(const effects *effect, const haptune_contact *contact,
    const haptune_estimate *axis, double rest)
{
    const double u = (effect->stiffness * (axis->last - rest)
        + effect->damping * axis->velocity) + effect->mass * axis->acceleration;
    const double low = effect->one_sided && contact->side < 0 ? 0.0 : -effect->force_level;
    const double high = effect->one_sided && contact->side > 0 ? 0.0 : effect->force_level;
    if (!(effect->stiffness > 0.0)) {
        return u;
    }
    return u < low ? low : u > high ? high : u;
}

/* A level some way nearer to what is asked for. */
static double faded(double level, double asked, double change)
{
    if (level < asked) {
        return level + change < asked ? level + change : asked;
    }
    return level - change > asked ? level - change : asked;
}

static uint32_t counted(uint32_t samples, int quiet)
{
    return !quiet ? 0 : samples < HAPTUNE_TAPS ? samples + 1 : HAPTUNE_TAPS;
}

/* One element goes on by a reading; asked: the level it is to have, change: how far it may fade. */
static void act(const effects *effect, haptune_contact *contact, const haptune_estimate *axis,
    double asked, double change)
{
    const int spring = effect->stiffness > 0.0;
    const int enters = asked > 0.0 && !contact->wanted && contact->level == 0.0;
    const double at_face = clamped(effect, contact, axis, contact->face);
    double u;
    if (enters && spring) {
        const double inside = contact->side * (contact->face - axis->last);
        contact->rest = effect->one_sided && !(inside > 0.0) ? contact->face : axis->last;
        contact->quiet = contact->clear = 0;
    }
    u = clamped(effect, contact, axis, contact->rest);
    contact->quiet = counted(contact->quiet, u == 0.0);
    contact->clear = counted(contact->clear, at_face == 0.0);
    if (effect->one_sided && contact->clear >= HAPTUNE_TAPS) {
        contact->rest = contact->face;
    }
    if (effect->fade < 1.0) {
        contact->level = faded(contact->level, asked, change);
    } else if (!spring || enters || asked < contact->level || contact->quiet >= HAPTUNE_TAPS) {
        contact->level = asked;
    }
    contact->force = contact->level > 0.0 ? -(contact->level * u) : 0.0;
    contact->wanted = asked > 0.0;
}

HAPTUNE_API void haptune_init(haptune_guard *guard)
{
    memset(guard, 0, sizeof *guard);
}

HAPTUNE_API haptune_status haptune_reset(
    haptune_guard *guard, uint64_t elements, double rest, int side)
{
    unsigned index;
    uint64_t wanted = 0;
    side = (side > 0) - (side < 0);
    guard->status = HAPTUNE_OK;
    if (elements & ~known) {
        guard->status = HAPTUNE_NOT_TOGETHER;
    } else if (!usable(rest)) {
        guard->status = HAPTUNE_NOT_FINITE;
    } else if ((elements & walls) && side == 0) {
        guard->status = HAPTUNE_NO_SIDE;
    }
    if (guard->status != HAPTUNE_OK) {
        end_contacts(guard, elements);
        return guard->status;
    }
    for (index = 0; index < COUNT; index++) {
        wanted |= guard->contacts[index].wanted ? bit(index) : 0;
    }
    for (index = 0; index < COUNT; index++) {
        if (!(elements & bit(index))) {
            continue;
        }
        if (played[index].stiffness > 0.0 && guard->contacts[index].force != 0.0) {
            guard->status = HAPTUNE_PUSHING;
            return guard->status;
        }
        if ((walls & bit(index)) && crowded(guard, index, rest, side, wanted & ~elements)) {
            guard->status = HAPTUNE_TOO_NARROW;
            return guard->status;
        }
    }
    for (index = 0; index < COUNT; index++) {
        haptune_contact *contact = &guard->contacts[index];
        if (elements & bit(index)) {
            contact->entered = 1;
            contact->wanted = 0;
            contact->side = side;
            contact->face = rest;
            contact->level = played[index].stiffness > 0.0 ? 0.0 : contact->level;
        }
    }
    return guard->status;
}

HAPTUNE_API double haptune_force(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain)
{
    unsigned index;
    int fades, pushing = 0;
    uint64_t acting = 0, fading = 0;
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
    if (!entered(guard, elements)) {
        return no_force(guard, HAPTUNE_NOT_ENTERED);
    }
    if (!usable(gain) || gain < 0.0 || gain > 1.0) {
        return no_force(guard, HAPTUNE_BAD_GAIN);
    }
    guard->status = together(guard, elements);
    if (guard->status != HAPTUNE_OK) {
        return no_force(guard, guard->status);
    }
    for (index = 0; index < COUNT; index++) {
        if (guard->contacts[index].level > 0.0) {
            acting |= bit(index);
            fading |= played[index].fade < 1.0 ? bit(index) : 0;
        }
    }
    if (together(guard, elements | fading) != HAPTUNE_OK) {
        elements &= acting | walls;
        if (together(guard, elements | fading) != HAPTUNE_OK) {
            return no_force(guard, HAPTUNE_NOT_TOGETHER);
        }
        guard->status = HAPTUNE_WAITING;
    }
    for (fades = 0; fades < 2; fades++) {
        for (index = 0; index < COUNT; index++) {
            if ((played[index].fade < 1.0) == fades) {
                act(&played[index], &guard->contacts[index], &guard->axis,
                    (elements & bit(index)) ? gain : 0.0,
                    pushing ? 0.0 : played[index].fade * steps);
            }
            pushing |= (walls & bit(index)) && guard->contacts[index].force != 0.0;
        }
    }
    for (index = 0; index < COUNT; index++) {
        const double most = guard->contacts[index].level * played[index].force_level;
        force += guard->contacts[index].force;
        guard->clamped |= guard->contacts[index].force != 0.0 && played[index].stiffness > 0.0
            && fabs(guard->contacts[index].force) >= most;
    }
    if (!usable(force)) {
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
${of_axes}