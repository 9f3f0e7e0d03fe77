"""The header of the C guard as text; $-names are filled in from a profile by c_guard.py."""

from __future__ import annotations

HEADER = """\
${heading}
#ifndef HAPTUNE_GUARD_H
#define HAPTUNE_GUARD_H

#include <stdint.h>

/* "static" where haptune_guard.c is included in a file of yours, as for a second axis. */
#ifndef HAPTUNE_API
#define HAPTUNE_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* First digits of the profile's digest: header and source must come from one profile. */
#define HAPTUNE_PROFILE ${tag}
#define HAPTUNE_DIGEST "${digest}"

/* s: period of the loop that calls haptune_force. */
#define HAPTUNE_SAMPLE_TIME ${sample_time}
/* Periods in a row without a good reading that the certificate covers. */
#define HAPTUNE_EXTRA_DELAY ${extra_delay}u
/* Readings that a velocity looks back. */
#define HAPTUNE_WINDOW ${window}

/* Elements; sets of them are joined by |. */
${elements}
/* Sets that may act at once, and every part of one; any other sum is not certified:
${together} */

typedef enum {
    HAPTUNE_OK = 0,
    HAPTUNE_NOT_TOGETHER, /* this set is not certified as a sum, or holds an unknown element */
    HAPTUNE_NOT_ENTERED,  /* no haptune_reset since the start, or since a fault */
    HAPTUNE_NOT_FINITE,   /* a reading, or what comes out, is no finite number */
    HAPTUNE_BAD_GAIN,     /* gain is not in [0, 1] */
    HAPTUNE_STALE,        /* the reading of this period was used before */
    HAPTUNE_LATE          /* more periods missed than are certified: reset to go on */
} haptune_status;

/* What one element remembers of the readings. */
typedef struct {
    int entered;
    uint32_t period; /* of the last reading */
    unsigned oldest; /* place of the oldest reading in past */
    double past[HAPTUNE_WINDOW];
    double last;
    double slope;
    double velocity[2]; /* now, and one reading before */
    double acceleration[2];
    double rest;
} haptune_contact;

/* One for each axis and loop; written by the functions below alone. */
typedef struct {
    haptune_status status; /* of the last call */
    int clamped;           /* 1 where the last force was cut at the limit */
    uint32_t missed;       /* periods without a good reading so far, for diagnosis */
    haptune_contact contacts[${count}];
} haptune_guard;

/* Before anything else: no element is entered. */
HAPTUNE_API void haptune_init(haptune_guard *guard);

/*
 * When elements are entered, in the period of their first force: their filters start as if the
 * device had rested at position (${length}) until now; rest (${length}) is where their springs give
 * no force. Other elements keep what they remember.
 */
HAPTUNE_API haptune_status haptune_reset(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double rest);

/*
 * The force (${force}) of a set of elements, every period while they are touched. 0.0 wherever
 * guard->status is not HAPTUNE_OK. Nothing is allocated; the time it takes is bounded.
 *
 * elements: any set certified above; 0 gives no force.
 * period:   number of the period in which the position was read, one more each period; it may wrap.
 * position: ${length}, where the device was certified: at the encoder.
 * gain:     0 to 1, for ramps and fades, slow against the loop; every gain in (0, ${gain}] is
 *           certified.
 */
HAPTUNE_API double haptune_force(
    haptune_guard *guard, uint64_t elements, uint32_t period, double position, double gain);

#ifdef __cplusplus
}
#endif

#endif
"""
