${heading}
#if defined(HAPTUNE_PROFILE) && HAPTUNE_PROFILE != ${tag}
#error "headers of two profiles in one source: give each profile a source of its own"
#endif
#ifndef HAPTUNE_GUARD_H
#define HAPTUNE_GUARD_H

#include <float.h>
#include <stdint.h>

/* Here too, since flags of the caller may lose a NaN before it gets to the guard. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST) \
    || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile without -ffast-math, -ffinite-math-only, -Ofast, /fp:fast: they take out tests for NaN"
#endif
#if FLT_RADIX != 2 || DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "the guard computes in doubles of 64 bits (IEEE 754), which double is not here"
#endif
typedef char haptune_constants_have_to_be_of_type_double[sizeof 1.0 == sizeof(double) ? 1 : -1];

/* "static" where haptune_guard.c is included in a file of yours, as for a second axis. */
#ifndef HAPTUNE_API
#define HAPTUNE_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* First digits of the profile's digest. What comes from another profile neither compiles nor links
 * with this: the functions below have them in their names. */
#define HAPTUNE_PROFILE ${tag}
#define HAPTUNE_DIGEST "${digest}"
#define haptune_init haptune_init_${word}
#define haptune_reset haptune_reset_${word}
#define haptune_force haptune_force_${word}

/* s: period of the loop that calls haptune_force. */
#define HAPTUNE_SAMPLE_TIME ${sample_time}
/* Periods in a row without a good reading that the certificate covers. */
#define HAPTUNE_EXTRA_DELAY ${extra_delay}u
/* Samples in a row for which a spring gives no force before its gain may rise. */
#define HAPTUNE_TAPS ${taps}u
/* Readings that a velocity looks back. */
#define HAPTUNE_WINDOW ${window}
/* ${length} a period: no reading can be farther both from the straight line through the last two and
 * from the one of one period earlier, should the last have been a small jump itself.
 * ${change_words} */
#define HAPTUNE_LARGEST_CHANGE ${change}

/* Elements; sets of them are joined by |. */
${elements}
/* Sets that may act at once, and every part of one; any other sum is not certified:
${together}
 * A wall, which pushes to one side only, may besides be met with each of them, and walls that push
 * to opposite sides with each other, where there is room between their faces. Never met at once:
${apart} */

typedef enum {
    HAPTUNE_OK = 0,
    HAPTUNE_WAITING,      /* not certified with what still fades out: what is new waits for that,
                             but for walls */
    HAPTUNE_NOT_TOGETHER, /* this set, with what still fades out, is not certified as a sum */
    HAPTUNE_NOT_ENTERED,  /* no haptune_reset since the start, or since contacts were ended */
    HAPTUNE_NO_SIDE,      /* a wall that pushes only was given no side */
    HAPTUNE_NOT_FINITE,   /* a reading, or what comes out, is no finite number below 2^64 */
    HAPTUNE_BAD_GAIN,     /* gain is not in [0, 1] */
    HAPTUNE_STALE,        /* the reading of this period was used before */
    HAPTUNE_GLITCH,       /* the device cannot have moved so far: the reading is not used */
    HAPTUNE_LATE,         /* more periods missed than are certified: reset to go on */
    HAPTUNE_PUSHING,      /* from haptune_reset, which did nothing: a spring gives force */
    HAPTUNE_TOO_NARROW    /* walls that push towards each other overlap, or their dampers do */
} haptune_status;

/* Velocity and acceleration of the axis; they run on whether or not anything is touched. */
typedef struct {
    int started;
    uint32_t period; /* of the last good reading */
    unsigned oldest; /* place of the oldest reading in past */
    double past[HAPTUNE_WINDOW];
    double last, slope;
    double earlier, earlier_slope; /* one period before */
    double velocity, acceleration;
    double of_velocity[2][2]; /* of each section, now and one reading before */
    double of_acceleration[2][2];
} haptune_estimate;

/* One element. */
typedef struct {
    int entered;
    int wanted; /* in the last call */
    int side;
    double face;           /* where its spring is to rest */
    double rest;           /* where it rests */
    double level;          /* 0 to 1: how much of it acts */
    double force;          /* of the last call */
    uint32_t quiet, clear; /* samples in a row without force resting there, and at its face */
} haptune_contact;

/* One for each axis and loop; written by the functions below alone. */
typedef struct {
    haptune_status status; /* of the last call */
    int clamped;           /* 1 where a spring, or the last force, was cut at its limit */
    uint32_t missed;       /* periods that were bridged so far, for diagnosis */
    uint32_t glitches;     /* readings that were not used because the device cannot move so */
    uint32_t waiting;      /* calls since the last good reading */
    double force;          /* of the last call, held where a reading is missed */
    haptune_estimate axis;
    haptune_contact contacts[${count}];
} haptune_guard;

/* Before anything else: nothing was read and no element is entered. The first reading is taken for
 * one of a device at rest. Where that moves farther in a period than HAPTUNE_LARGEST_CHANGE, the
 * next calls say HAPTUNE_GLITCH and HAPTUNE_LATE, which ends the contacts; reset then. */
HAPTUNE_API void haptune_init(haptune_guard *guard);

/*
 * Before elements give their first force, and when walls are to stand elsewhere. Of walls, rest
 * (${length}) is the face: side > 0 pushes towards growing positions, the wall lying below rest,
 * side < 0 the other way. Other springs rest where they are entered, and take any side.
 *
 * HAPTUNE_PUSHING and HAPTUNE_TOO_NARROW leave all as it was; what else is wrong ends the contacts.
 */
HAPTUNE_API haptune_status haptune_reset(
    haptune_guard *guard, uint64_t elements, double rest, int side);

/*
 * The force (${force}) of a set of elements. Called every period, with 0 where nothing is touched,
 * so that velocity and acceleration are known when something is. Nothing is allocated; the time it
 * takes is bounded.
 *
 * A reading that is missed, is used twice, is no number or cannot be gives the force of the call
 * before; what else is wrong gives 0.0. guard->status says which.
 *
 * elements: any set certified above. What leaves the set fades out first if it has to. A wall stays
 *           in it wherever the device is: it knows itself when to push.
 * period:   number of the period in which the position was read, one more each period; it may wrap.
 * position: ${length}, where the device was certified: at the encoder.
 * gain:     0 to 1. It falls at once; that of a spring rises when it is entered, and otherwise
 *           after HAPTUNE_TAPS samples without force.
 */
HAPTUNE_API double haptune_force(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain);
${of_axes}
#ifdef __cplusplus
}
#endif

#endif
