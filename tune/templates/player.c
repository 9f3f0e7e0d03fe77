/* Plays a planned force on a device and logs time, force and position. C99 and a POSIX clock.
 *
 * Fill in the device below, then:
 *     cc -std=c99 -O2 -o player player.c -lm
 *     ./player force.csv log.csv --force 14 --travel 0.1 --speed 1.0
 * and keep a hand on the emergency stop of the device, which must not depend on this program.
 *
 * Row k of force.csv is held from k T on; it has a force, or one of each axis (force_x,force_y).
 * Each sample the positions are read, compared with the limits, and only then the forces are
 * written. Whatever ends the play but a kill (SIGKILL) writes zero force, and the rows up to there
 * are kept. SI units: N, m, m/s; N m, rad, rad/s for a rotary axis. Force is positive along
 * +position. The device starts at rest in the middle of its travel, with no hand on it.
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PLAYER_FILL_IN (-99) /* what is not filled in returns this: then nothing is played */

/* ------------------------------------------------------------------------- fill in: the device */

/* Read positions[0] to positions[axes - 1] in m (rad), in the order of the columns of the plan.
 * Return 0, or anything else if it failed. */
static int device_read_positions(void *context, int axes, double *positions)
{
    (void)context, (void)axes;
    positions[0] = 0.0;
    return PLAYER_FILL_IN;
}

/* Apply a force to each axis in N (N m) until the next call. Return 0, or anything else if it
 * failed. */
static int device_write_forces(void *context, int axes, const double *forces)
{
    (void)context, (void)axes;
    (void)forces;
    return PLAYER_FILL_IN;
}

/* Return 1 while an emergency stop or an enabling switch says that the play must end. */
static int device_stop_pressed(void *context)
{
    (void)context;
    return 0; /* fill in if the device has one; Ctrl-C stops in any case */
}

/* ---------------------------------------------------------------------- the player: leave as is */

#define PLAYER_MOST_AXES 6

typedef struct player_device {
    int (*read_positions)(void *context, int axes, double *positions);
    int (*write_forces)(void *context, int axes, const double *forces);
    int (*stop_pressed)(void *context);
    double (*wait_until)(void *context, double time); /* s; returns the time it is */
    void *context;
} player_device;

typedef struct player_limits { /* of every axis */
    double force;  /* largest |force| in the plan, N (N m) */
    double travel; /* farthest from the start, m (rad) */
    double speed;  /* m/s (rad/s) */
    double ramp;   /* s over which the force fades in and out; 0 if the plan does so itself */
} player_limits;

typedef struct player_rows {
    char names[PLAYER_MOST_AXES][32]; /* of the columns of force, without "force" */
    int axes;
    long count;
    double sample_time; /* s */
    double *time;       /* s */
    double *force;      /* N (N m), those of one row beside each other */
    double *position;   /* m (rad), likewise */
} player_rows;

typedef enum player_end {
    PLAYER_DONE,
    PLAYER_TOO_FAR,
    PLAYER_TOO_FAST,
    PLAYER_STOPPED,
    PLAYER_NOT_READ,
    PLAYER_NOT_WRITTEN,
    PLAYER_LATE,
    PLAYER_STILL_ON /* the last write of zero failed as well: cut the power */
} player_end;

static const char *const player_words[] = {
    "played to the end",
    "stopped: travel exceeded",
    "stopped: too fast",
    "stopped: emergency stop",
    "stopped: the position could not be read, or is not a number",
    "stopped: the force could not be written",
    "stopped: a sample came too late",
    "ZERO FORCE COULD NOT BE WRITTEN: CUT THE POWER",
};

/* Speed is a difference over this time, so that one encoder count is no speed, s. */
#define PLAYER_SPEED_OVER 0.01
/* A force that was held this much longer than planned ends the play, s; at least ten samples. */
#define PLAYER_LATEST 0.02
/* Attempts to write zero. */
#define PLAYER_ATTEMPTS 3

static volatile sig_atomic_t player_interrupted = 0;

/* The part of its force that row k of a plan is played with. */
static double player_faded(const player_rows *plan, const player_limits *limits, long k)
{
    const double end = (double)(plan->count - 1 - k) * plan->sample_time;
    const double begin = (double)k * plan->sample_time;
    const double least = begin < end ? begin : end;
    return limits->ramp > least ? least / limits->ramp : 1.0;
}

static int player_switch_off(const player_device *device, int axes)
{
    const double none[PLAYER_MOST_AXES] = { 0.0 };
    int attempt;
    for (attempt = 0; attempt < PLAYER_ATTEMPTS; attempt++) {
        if (device->write_forces(device->context, axes, none) == 0) {
            return 0;
        }
    }
    return -1;
}

/* How far the axis is that moved most. */
static double player_apart(const double *positions, const double *others, int axes)
{
    double most = 0.0;
    int axis;
    for (axis = 0; axis < axes; axis++) {
        most = fmax(most, fabs(positions[axis] - others[axis]));
    }
    return most;
}

/* Plays the plan; the log needs room for one row more than the plan. */
static player_end player_play(const player_device *device, const player_rows *plan,
    const player_limits *limits, player_rows *log)
{
    const double T = plan->sample_time;
    const double latest = PLAYER_LATEST > 10.0 * T ? PLAYER_LATEST : 10.0 * T;
    const long apart = PLAYER_SPEED_OVER > T ? (long)(PLAYER_SPEED_OVER / T + 0.5) : 1;
    const double began = device->wait_until(device->context, 0.0);
    const int axes = plan->axes;
    player_end end = PLAYER_DONE;
    long k;
    int axis, over;
    memcpy(log->names, plan->names, sizeof log->names);
    log->axes = axes;
    log->count = 0;
    log->sample_time = T;
    for (k = 0; k <= plan->count; k++) {
        const double due = began + (double)k * T;
        const double now = device->wait_until(device->context, due);
        double *positions = log->position + k * axes, *forces = log->force + k * axes;
        double part;
        int failed;
        for (axis = 0; axis < axes; axis++) {
            positions[axis] = NAN;
        }
        failed = device->read_positions(device->context, axes, positions);
        for (axis = 0; axis < axes; axis++) {
            failed |= !isfinite(positions[axis]);
        }
        if (failed) {
            end = PLAYER_NOT_READ;
            break;
        }
        if (player_interrupted || device->stop_pressed(device->context)) {
            end = PLAYER_STOPPED;
        } else if (player_apart(positions, log->position, axes) > limits->travel) {
            end = PLAYER_TOO_FAR;
        } else if (k >= apart && player_apart(positions, log->position + (k - apart) * axes, axes)
                > limits->speed * (now - began - log->time[k - apart])) {
            end = PLAYER_TOO_FAST;
        } else if (now - due > latest) {
            end = PLAYER_LATE;
        }
        /* The row after the last ends it: from then on the force is zero. */
        over = end != PLAYER_DONE || k == plan->count;
        part = over ? 0.0 : player_faded(plan, limits, k);
        for (axis = 0; axis < axes; axis++) {
            forces[axis] = over ? 0.0 : part * plan->force[k * axes + axis];
        }
        if (!over && device->write_forces(device->context, axes, forces) != 0) {
            end = PLAYER_NOT_WRITTEN;
            break;
        }
        log->time[log->count++] = now - began;
        if (over) {
            break;
        }
    }
    return player_switch_off(device, axes) == 0 ? end : PLAYER_STILL_ON;
}

/* Writes a log as CSV. Returns 0, or -1 if it is not whole. */
static int player_write(FILE *file, const player_rows *log)
{
    long k;
    int axis;
    fprintf(file, "time");
    for (axis = 0; axis < 2 * log->axes; axis++) {
        const int force = axis < log->axes;
        fprintf(file, ",%s%s", force ? "force" : "position", log->names[axis % log->axes]);
    }
    for (k = 0; k < log->count; k++) {
        fprintf(file, "\n%.9f", log->time[k]);
        for (axis = 0; axis < 2 * log->axes; axis++) {
            const double *row = axis < log->axes ? log->force : log->position;
            fprintf(file, ",%.12g", row[k * log->axes + axis % log->axes]);
        }
    }
    fprintf(file, "\n");
    return fflush(file) != 0 || ferror(file) ? -1 : 0;
}

/* Room for a number of rows. Returns 0, or -1 if there is none. */
static int player_rows_new(player_rows *rows, long room, int axes)
{
    const size_t size = (size_t)room * sizeof(double);
    memset(rows, 0, sizeof *rows);
    rows->axes = axes;
    rows->time = malloc(size);
    rows->force = malloc(size * (size_t)axes);
    rows->position = malloc(size * (size_t)axes);
    return rows->time && rows->force && rows->position ? 0 : -1;
}

/* The axes of a header: time,force or time,force_x,force_y. Returns 0 if it is another line. */
static int player_axes(char *line, char names[][32])
{
    char *word = strtok(line, ",\r\n");
    int axes = 0;
    if (!word || strcmp(word, "time") != 0) {
        return 0;
    }
    while ((word = strtok(NULL, ",\r\n"))) {
        if (axes == PLAYER_MOST_AXES || strncmp(word, "force", 5) != 0 || strlen(word) > 36) {
            return 0;
        }
        strcpy(names[axes++], word + 5);
    }
    return axes;
}

/* Reads time and forces. Returns NULL, or what is wrong with the file. */
static const char *player_load(FILE *file, const player_limits *limits, player_rows *plan)
{
    char line[256], names[PLAYER_MOST_AXES][32];
    long room = 1024;
    int axis;
    const int axes = fgets(line, sizeof line, file) ? player_axes(line, names) : 0;
    if (axes == 0) {
        return "does not begin with the line time,force or time,force_x,force_y";
    }
    if (player_rows_new(plan, room, axes) != 0) {
        return "needs more memory than there is";
    }
    memcpy(plan->names, names, sizeof names);
    while (fgets(line, sizeof line, file)) {
        char *cell = line, *end = line;
        double *time, *forces;
        int rest;
        if (plan->count == room) {
            time = realloc(plan->time, 2 * (size_t)room * sizeof *time);
            plan->time = time ? time : plan->time;
            forces = realloc(plan->force, 2 * (size_t)(room * axes) * sizeof *forces);
            plan->force = forces ? forces : plan->force;
            if (!time || !forces) {
                return "needs more memory than there is";
            }
            room *= 2;
        }
        time = plan->time + plan->count;
        forces = plan->force + plan->count * axes;
        for (axis = -1; axis < axes; axis++) {
            double *value = axis < 0 ? time : forces + axis;
            *value = strtod(cell, &end);
            rest = axis < axes - 1 ? *end != ',' : end[strspn(end, " \t\r\n")] != '\0';
            if (end == cell || rest || !isfinite(*value)) {
                return "has a row that is not a number for each column";
            }
            if (axis >= 0 && fabs(*value) > limits->force) {
                return "holds a force beyond --force";
            }
            cell = end + 1;
        }
        plan->count++;
    }
    if (plan->count < 2) {
        return "has less than two rows";
    }
    plan->sample_time = (plan->time[plan->count - 1] - plan->time[0]) / (double)(plan->count - 1);
    for (room = 0; room < plan->count; room++) {
        const double due = plan->time[0] + (double)room * plan->sample_time;
        if (!(plan->sample_time > 0.0) || fabs(plan->time[room] - due) > 1e-3 * plan->sample_time) {
            return "has times that are not evenly spaced";
        }
    }
    for (axis = 0; axis < axes; axis++) {
        const double last = plan->force[(plan->count - 1) * axes + axis];
        if (limits->ramp <= 0.0 && (plan->force[axis] != 0.0 || last != 0.0)) {
            return "does not begin and end with zero force; add --ramp SECONDS";
        }
    }
    return NULL;
}

#ifndef PLAYER_WITHOUT_MAIN

static double player_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double player_wait_until(void *context, double time)
{
    double left;
    (void)context;
    while ((left = time - player_now()) > 0.0) {
        struct timespec pause;
        pause.tv_sec = (time_t)left;
        pause.tv_nsec = (long)(1e9 * (left - (double)pause.tv_sec));
        nanosleep(&pause, NULL);
    }
    return player_now();
}

static void player_interrupt(int signal_number)
{
    (void)signal_number;
    player_interrupted = 1;
}

/* From here on what asks the program to end or to stop ends the play. SIGHUP: the terminal has gone. */
static void player_listen(void)
{
#ifdef SIGHUP
    static const int signals[] = { SIGHUP, SIGINT, SIGPIPE, SIGQUIT, SIGTERM, SIGTSTP };
    struct sigaction action;
    size_t each;
    memset(&action, 0, sizeof action);
    action.sa_handler = player_interrupt;
    action.sa_flags = SA_RESTART;
    for (each = 0; each < sizeof signals / sizeof *signals; each++) {
        sigaction(signals[each], &action, NULL);
    }
#else /* Windows */
    signal(SIGINT, player_interrupt);
    signal(SIGTERM, player_interrupt);
#endif
}

static int player_fail(const char *subject, const char *problem)
{
    fprintf(stderr, "player: %s %s\n", subject, problem);
    return 2;
}

int main(int argc, char **argv)
{
    const player_device device = { device_read_positions, device_write_forces,
        device_stop_pressed, player_wait_until, NULL };
    player_limits limits = { 0.0, 0.0, 0.0, 0.0 };
    player_rows plan, log;
    player_end end;
    FILE *file;
    const char *problem;
    double places[PLAYER_MOST_AXES], none[PLAYER_MOST_AXES] = { 0.0 };
    int word, lost;
    for (word = 3; word + 1 < argc; word += 2) {
        double *limit = strcmp(argv[word], "--force") == 0 ? &limits.force
            : strcmp(argv[word], "--travel") == 0 ? &limits.travel
            : strcmp(argv[word], "--speed") == 0 ? &limits.speed
            : strcmp(argv[word], "--ramp") == 0 ? &limits.ramp
            : NULL;
        char *tail;
        if (!limit) {
            return player_fail(argv[word], "is no limit: --force, --travel, --speed and --ramp are");
        }
        *limit = strtod(argv[word + 1], &tail);
        if (tail == argv[word + 1] || *tail || !isfinite(*limit) || *limit < 0.0
            || (*limit == 0.0 && limit != &limits.ramp)) {
            return player_fail(argv[word + 1], "is no limit: give a number above 0, without a unit");
        }
    }
    if (argc < 3 || word != argc || !(limits.force > 0 && limits.travel > 0 && limits.speed > 0)) {
        return player_fail("usage:",
            "player force.csv log.csv --force N --travel M --speed M/S [--ramp S]");
    }
    if (!(file = fopen(argv[1], "r"))) {
        return player_fail(argv[1], strerror(errno));
    }
    problem = player_load(file, &limits, &plan);
    fclose(file);
    if (problem) {
        return player_fail(argv[1], problem);
    }
    if (device_read_positions(NULL, plan.axes, places) == PLAYER_FILL_IN) {
        return player_fail(argv[0], "has no device yet: fill in device_read_positions");
    }
    if (device_write_forces(NULL, plan.axes, none) == PLAYER_FILL_IN) {
        return player_fail(argv[0], "has no device yet: fill in device_write_forces");
    }
    if (player_rows_new(&log, plan.count + 1, plan.axes) != 0) {
        return player_fail(argv[2], "needs more memory than there is");
    }
    /* Opened before anything moves: a log that cannot be kept is not played. */
    if (!(file = fopen(argv[2], "w"))) {
        return player_fail(argv[2], strerror(errno));
    }
    player_listen();
    end = player_play(&device, &plan, &limits, &log);
    lost = player_write(file, &log);
    if (fclose(file) != 0 || lost != 0) {
        return player_fail(argv[2], "was not written whole");
    }
    fprintf(stderr, "player: %s; %ld rows in %s\n", player_words[end], log.count, argv[2]);
    return end == PLAYER_DONE ? 0 : 1;
}

#endif
