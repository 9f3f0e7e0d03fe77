
/* Of a sum of squares to 1, and of a product of normals to -1 or 1. */
#define ROUNDING 1e-9
/* By less than this part of all that it is made of nothing is beyond a face. */
#define SMALL 1e-12
/* So much shorter that no rounding lets a vector be longer than it may be. */
#define SHORTER (1.0 - 8.0 * DBL_EPSILON)

static double product(const double one[HAPTUNE_AXES], const double other[HAPTUNE_AXES])
{
    double sum = 0.0;
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        sum += one[axis] * other[axis];
    }
    return sum;
}

/* Adds so many times a vector to another. */
static void add(double to[HAPTUNE_AXES], double times, const double vector[HAPTUNE_AXES])
{
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        to[axis] += times * vector[axis];
    }
}

/* Shortens a vector to a length, and gives the length it has then. */
static double shortened(double vector[HAPTUNE_AXES], double most)
{
    const double length = sqrt(product(vector, vector));
    unsigned axis;
    if (!(length > most * SHORTER)) {
        return length;
    }
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        vector[axis] *= most * SHORTER / length;
    }
    return most;
}

/* What is left of a vector beside some normals: its square, and how much of each was taken away. */
static double beside(const haptune_face faces[HAPTUNE_FACES], const unsigned held[HAPTUNE_AXES],
    unsigned count, double vector[HAPTUNE_AXES], double parts[HAPTUNE_AXES])
{
    double basis[HAPTUNE_AXES][HAPTUNE_AXES], upper[HAPTUNE_AXES][HAPTUNE_AXES];
    unsigned one, other, axis;
    count = count < HAPTUNE_AXES ? count : HAPTUNE_AXES; /* as it is: compilers do not see it */
    for (one = 0; one < count; one++) {
        memcpy(basis[one], faces[held[one]].normal, sizeof basis[one]);
        for (other = 0; other < one; other++) {
            upper[other][one] = product(basis[other], basis[one]);
            add(basis[one], -upper[other][one], basis[other]);
        }
        upper[one][one] = sqrt(product(basis[one], basis[one]));
        for (axis = 0; axis < HAPTUNE_AXES; axis++) {
            basis[one][axis] /= upper[one][one];
        }
        parts[one] = product(basis[one], vector);
        add(vector, -parts[one], basis[one]);
    }
    for (one = count; one-- > 0;) {
        for (other = one + 1; other < count; other++) {
            parts[one] -= upper[one][other] * parts[other];
        }
        parts[one] /= upper[one][one];
    }
    return product(vector, vector);
}

/* The face of a set beyond whose limit a point is farthest; HAPTUNE_FACES where there is none. */
static unsigned farthest(const haptune_axes *device, uint32_t faces,
    const double limits[HAPTUNE_FACES], const double point[HAPTUNE_AXES], double size)
{
    unsigned place, found = HAPTUNE_FACES;
    double most = 0.0;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        const double beyond = limits[place] - product(device->faces[place].normal, point);
        if ((faces >> place & 1u) && beyond > most
            && beyond > SMALL * (size + fabs(limits[place]))) {
            most = beyond;
            found = place;
        }
    }
    return found;
}

/*
 * Moves a point to the nearest one that is within the limits of a set of faces, along their normals.
 * 0 where there is none. The dual active set method of Goldfarb and Idnani, Mathematical Programming
 * 27, 1983.
 */
static int project(const haptune_axes *device, uint32_t faces, const double limits[HAPTUNE_FACES],
    double point[HAPTUNE_AXES])
{
    double pushes[HAPTUNE_FACES] = {0.0}, start[HAPTUNE_AXES], left[HAPTUNE_AXES], parts[HAPTUNE_AXES];
    unsigned held[HAPTUNE_AXES], count = 0, tries, place, next = HAPTUNE_FACES;
    memcpy(start, point, sizeof start);
    for (tries = 0; tries < 8 * HAPTUNE_FACES; tries++) {
        unsigned dropped = count;
        double step = DBL_MAX, square;
        if (next == HAPTUNE_FACES) {
            next = farthest(device, faces, limits, point, sqrt(product(start, start)));
            if (next == HAPTUNE_FACES) {
                return 1;
            }
            faces &= ~(UINT32_C(1) << next);
        }
        memcpy(left, device->faces[next].normal, sizeof left);
        square = beside(device->faces, held, count, left, parts);
        for (place = 0; place < count; place++) {
            if (parts[place] > 0.0 && pushes[held[place]] < step * parts[place]) {
                step = pushes[held[place]] / parts[place];
                dropped = place;
            }
        }
        if (count < HAPTUNE_AXES && square > SMALL) {
            const double whole
                = (limits[next] - product(device->faces[next].normal, point)) / square;
            if (whole <= step) {
                step = whole;
                dropped = HAPTUNE_FACES;
            }
        } else if (dropped == count) {
            return 0;
        }
        for (place = 0; place < count; place++) {
            pushes[held[place]] -= step * parts[place];
        }
        pushes[next] += step;
        if (dropped == HAPTUNE_FACES) {
            held[count++] = next;
            next = HAPTUNE_FACES;
        } else {
            pushes[held[dropped]] = 0.0;
            faces |= UINT32_C(1) << held[dropped];
            held[dropped] = held[--count];
        }
        memcpy(point, start, sizeof start);
        for (place = 0; place < HAPTUNE_FACES; place++) {
            if (pushes[place] != 0.0) {
                add(point, pushes[place], device->faces[place].normal);
            }
        }
    }
    return 1;
}

/* As read_position, of all axes or of none. */
static haptune_status read_positions(haptune_axes *device, uint32_t steps, uint32_t period,
    const double position[HAPTUNE_AXES])
{
    haptune_estimate *axes = device->axes;
    haptune_status fault = HAPTUNE_OK;
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        if (!usable(position[axis])) {
            fault = HAPTUNE_NOT_FINITE;
        } else if (fault == HAPTUNE_OK && axes[axis].started && steps != 0
            && steps - 1 <= HAPTUNE_EXTRA_DELAY && !plausible(&axes[axis], steps, position[axis])) {
            fault = HAPTUNE_GLITCH;
        }
    }
    if (fault != HAPTUNE_NOT_FINITE && axes[0].started && steps == 0) {
        fault = HAPTUNE_STALE;
    }
    device->glitches += fault == HAPTUNE_GLITCH;
    if (fault == HAPTUNE_OK) {
        const int started = axes[0].started;
        const int gap = started && steps - 1 > HAPTUNE_EXTRA_DELAY;
        for (axis = 0; axis < HAPTUNE_AXES; axis++) {
            const double moved = position[axis] - axes[axis].last;
            if (started && !gap) {
                bridge(&axes[axis], steps, position[axis]);
            } else {
                start(&axes[axis], period, position[axis],
                    gap ? moved / (HAPTUNE_SAMPLE_TIME * steps) : 0.0);
            }
        }
        device->missed += gap ? 0 : steps - 1;
        device->waiting = 0;
        return gap ? HAPTUNE_LATE : HAPTUNE_OK;
    }
    device->waiting++;
    if (axes[0].started && (device->waiting > HAPTUNE_EXTRA_DELAY || steps > HAPTUNE_EXTRA_DELAY)) {
        return HAPTUNE_LATE;
    }
    return fault;
}

/* Whether faces and elements may act at once: walls along one line, each with room between its own. */
static haptune_status fitting(const haptune_axes *device, uint64_t elements, uint32_t faces)
{
    unsigned one, other;
    if (!certified(elements)) {
        return HAPTUNE_NOT_TOGETHER;
    }
    for (one = 0; one < HAPTUNE_FACES; one++) {
        const haptune_face *here = &device->faces[one];
        uint64_t ahead = elements | bit(here->element);
        uint32_t own = 0;
        double limits[HAPTUNE_FACES], point[HAPTUNE_AXES] = {0.0};
        if (!(faces >> one & 1u)) {
            continue;
        }
        for (other = 0; other < HAPTUNE_FACES; other++) {
            const haptune_face *there = &device->faces[other];
            const double turned = product(here->normal, there->normal);
            limits[other] = there->offset;
            if (!(faces >> other & 1u)) {
                continue;
            }
            if (there->element == here->element) {
                own |= UINT32_C(1) << other;
            } else if (turned >= 1.0 - ROUNDING) {
                ahead |= bit(there->element);
            } else if (turned > ROUNDING - 1.0) {
                return HAPTUNE_NOT_TOGETHER;
            } else if (narrow(&played[here->element], &played[there->element],
                           -there->offset - here->offset)) {
                return HAPTUNE_TOO_NARROW;
            }
        }
        if (!certified(ahead)) {
            return HAPTUNE_NOT_TOGETHER;
        }
        /* Asked once for each wall, at its last face. */
        if (own < UINT32_C(2) << one && !project(device, own, limits, point)) {
            return HAPTUNE_TOO_NARROW;
        }
    }
    return HAPTUNE_OK;
}

static haptune_status none(haptune_axes *device, haptune_status reason)
{
    unsigned place;
    for (place = 0; place < COUNT; place++) {
        haptune_element *element = &device->elements[place];
        element->contact.wanted = 0;
        element->contact.level = element->contact.force = 0.0;
        memset(element->force, 0, sizeof element->force);
    }
    for (place = 0; place < HAPTUNE_FACES; place++) {
        device->faces[place].acting = device->faces[place].pushing = 0;
    }
    memset(device->force, 0, sizeof device->force);
    device->status = reason;
    return reason;
}

/*
 * Takes from u what a wall leaves free: the nearest place in the room of its faces, times K. New
 * faces come without more force: where the device is behind one, or where what pushes leaves it, it
 * rests there, until it has given no force where it is to stand for HAPTUNE_TAPS samples.
 */
static void leave_room(haptune_axes *device, unsigned wall, uint32_t faces, double u[HAPTUNE_AXES])
{
    const double stiffness = played[wall].stiffness, size = sqrt(product(u, u));
    double limits[HAPTUNE_FACES], free[HAPTUNE_AXES];
    uint32_t before = 0, fresh;
    unsigned place, axis;
    int pushing;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        haptune_face *face = &device->faces[place];
        if (face->element == wall) {
            face->acting = face->acting && (faces >> place & 1u);
            face->pushing = 0;
            before |= face->acting ? UINT32_C(1) << place : 0;
        }
        limits[place] = stiffness * face->rest;
    }
    memcpy(free, u, sizeof free);
    project(device, before, limits, free);
    pushing = memcmp(free, u, sizeof free) != 0;
    fresh = faces & ~before;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        haptune_face *face = &device->faces[place];
        if (fresh >> place & 1u) {
            double there = 0.0;
            for (axis = 0; axis < HAPTUNE_AXES; axis++) {
                there += face->normal[axis] * device->axes[axis].last;
            }
            face->rest = face->offset - there > 0.0 ? there : face->offset;
            limits[place] = stiffness * face->rest;
            if (pushing && product(face->normal, free) < limits[place]) {
                limits[place] = product(face->normal, free);
                face->rest = limits[place] / stiffness;
            }
            face->acting = 1;
            face->clear = 0;
        }
    }
    if (fresh) {
        memcpy(free, u, sizeof free);
        project(device, faces, limits, free);
        pushing = memcmp(free, u, sizeof free) != 0;
    }
    for (place = 0; place < HAPTUNE_FACES; place++) {
        haptune_face *face = &device->faces[place];
        if (faces >> place & 1u) {
            const double there = product(face->normal, free);
            face->clear = counted(face->clear, there >= stiffness * face->offset);
            face->rest = face->clear >= HAPTUNE_TAPS ? face->offset : face->rest;
            face->pushing = pushing
                && there - limits[place] <= SMALL * (size + fabs(limits[place]));
        }
    }
    add(u, -1.0, free);
}

/* As act, of an element that is the same in every direction, or of a wall at a set of its faces. */
static void act_on(
    haptune_axes *device, unsigned place, uint32_t faces, double asked, double change)
{
    const effects *effect = &played[place];
    haptune_element *element = &device->elements[place];
    haptune_contact *contact = &element->contact;
    const int spring = effect->stiffness > 0.0, wall = (walls & bit(place)) != 0;
    const int enters = asked > 0.0 && !contact->wanted && contact->level == 0.0;
    double u[HAPTUNE_AXES], length;
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        if (enters && spring) {
            element->rest[axis] = wall ? 0.0 : device->axes[axis].last;
            contact->quiet = 0;
        }
        u[axis] = (effect->stiffness * (device->axes[axis].last - element->rest[axis])
            + effect->damping * device->axes[axis].velocity)
            + effect->mass * device->axes[axis].acceleration;
    }
    if (wall) {
        leave_room(device, place, faces, u);
    }
    length = shortened(u, spring ? effect->force_level : DBL_MAX);
    contact->quiet = counted(contact->quiet, length == 0.0);
    if (effect->fade < 1.0) {
        contact->level = faded(contact->level, asked, change);
    } else if (!spring || enters || asked < contact->level || contact->quiet >= HAPTUNE_TAPS) {
        contact->level = asked;
    }
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        element->force[axis] = contact->level > 0.0 ? -(contact->level * u[axis]) : 0.0;
    }
    contact->force = contact->level * length;
    contact->wanted = asked > 0.0;
}

/* Those of a set of faces at which one element pushes. */
static uint32_t faces_of(const haptune_axes *device, unsigned element, uint32_t faces)
{
    uint32_t own = 0;
    unsigned place;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        own |= device->faces[place].element == element ? UINT32_C(1) << place : 0;
    }
    return own & faces;
}

/* All go on by a reading: walls, what else is switched, and then what fades. */
static void act_all(
    haptune_axes *device, uint64_t elements, uint32_t faces, double gain, uint32_t steps)
{
    unsigned place, part;
    int pushing = 0;
    for (part = 0; part < 3; part++) {
        for (place = 0; place < COUNT; place++) {
            const int wall = (walls & bit(place)) != 0;
            if (part == (wall ? 0u : played[place].fade < 1.0 ? 2u : 1u)) {
                const uint32_t own = wall && gain > 0.0 ? faces_of(device, place, faces) : 0;
                act_on(device, place, own, own || (elements & bit(place)) ? gain : 0.0,
                    pushing ? 0.0 : played[place].fade * steps);
                pushing |= wall && device->elements[place].contact.force != 0.0;
            }
        }
    }
}

HAPTUNE_API void haptune_axes_init(haptune_axes *device)
{
    memset(device, 0, sizeof *device);
}

HAPTUNE_API haptune_status haptune_axes_enter(haptune_axes *device, uint64_t elements)
{
    unsigned place;
    device->status = elements & (~known | walls) ? HAPTUNE_NOT_TOGETHER : HAPTUNE_OK;
    for (place = 0; place < COUNT; place++) {
        const haptune_contact *contact = &device->elements[place].contact;
        if ((elements & bit(place)) && device->status == HAPTUNE_OK
            && played[place].stiffness > 0.0 && contact->force != 0.0) {
            device->status = HAPTUNE_PUSHING;
        }
    }
    for (place = 0; place < COUNT; place++) {
        haptune_element *element = &device->elements[place];
        if ((elements & bit(place)) && device->status == HAPTUNE_OK) {
            element->contact.entered = 1;
            element->contact.wanted = 0;
            element->contact.level = played[place].stiffness > 0.0 ? 0.0 : element->contact.level;
        }
    }
    return device->status;
}

HAPTUNE_API haptune_status haptune_axes_place(haptune_axes *device, unsigned face, uint64_t element,
    const double normal[HAPTUNE_AXES], double offset)
{
    haptune_face before, *here = &device->faces[face % HAPTUNE_FACES];
    uint32_t wanted = UINT32_C(1) << face % HAPTUNE_FACES;
    unsigned place;
    int numbers = usable(offset);
    device->status = HAPTUNE_OK;
    if (face >= HAPTUNE_FACES || !(element & walls) || (element & (element - 1))) {
        device->status = HAPTUNE_NOT_TOGETHER;
        return device->status;
    }
    if (here->pushing) {
        device->status = HAPTUNE_PUSHING;
        return device->status;
    }
    for (place = 0; place < HAPTUNE_AXES; place++) {
        numbers = numbers && usable(normal[place]);
    }
    if (!numbers || fabs(product(normal, normal) - 1.0) > ROUNDING) {
        memset(here, 0, sizeof *here);
        device->status = numbers ? HAPTUNE_NO_SIDE : HAPTUNE_NOT_FINITE;
        return device->status;
    }
    before = *here;
    memset(here, 0, sizeof *here);
    memcpy(here->normal, normal, sizeof here->normal);
    here->entered = 1;
    here->offset = here->rest = offset;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        wanted |= device->faces[place].acting ? UINT32_C(1) << place : 0;
    }
    for (place = 0; place < COUNT; place++) {
        here->element = (element & bit(place)) ? place : here->element;
    }
    device->status = fitting(device, 0, wanted);
    if (device->status != HAPTUNE_OK) {
        *here = before;
    }
    return device->status;
}

HAPTUNE_API haptune_status haptune_axes_force(haptune_axes *device, uint64_t elements,
    uint32_t faces, uint32_t period, const double position[HAPTUNE_AXES], double gain,
    double force[HAPTUNE_AXES])
{
    unsigned place, axis;
    uint64_t acting = 0, fading = 0;
    double sum[HAPTUNE_AXES] = {0.0};
    const uint32_t steps = device->axes[0].started ? period - device->axes[0].period : 1;
    device->clamped = 0;
    device->status = read_positions(device, steps, period, position);
    if (device->status == HAPTUNE_LATE) {
        none(device, HAPTUNE_LATE);
        memset(device->elements, 0, sizeof device->elements);
        memset(device->faces, 0, sizeof device->faces);
    }
    memcpy(force, device->force, sizeof device->force);
    if (device->status != HAPTUNE_OK) {
        return device->status;
    }
    memset(force, 0, sizeof device->force);
    for (place = 0; place < COUNT; place++) {
        const haptune_contact *contact = &device->elements[place].contact;
        if ((elements & bit(place)) && !contact->entered) {
            return none(device, HAPTUNE_NOT_ENTERED);
        }
        if (!(walls & bit(place)) && contact->level > 0.0) {
            acting |= bit(place);
            fading |= played[place].fade < 1.0 ? bit(place) : 0;
        }
    }
    for (place = 0; place < 32; place++) {
        if ((faces >> place & 1u)
            && (place >= HAPTUNE_FACES || !device->faces[place].entered)) {
            return none(device, HAPTUNE_NOT_ENTERED);
        }
    }
    if (!usable(gain) || gain < 0.0 || gain > 1.0) {
        return none(device, HAPTUNE_BAD_GAIN);
    }
    device->status = fitting(device, elements, faces);
    if (device->status != HAPTUNE_OK) {
        return none(device, device->status);
    }
    if ((fading & ~elements) && fitting(device, elements | fading, faces) != HAPTUNE_OK) {
        elements &= acting;
        if (fitting(device, elements | fading, faces) != HAPTUNE_OK) {
            return none(device, HAPTUNE_NOT_TOGETHER);
        }
        device->status = HAPTUNE_WAITING;
    }
    act_all(device, elements, faces, gain, steps);
    for (place = 0; place < COUNT; place++) {
        const haptune_contact *contact = &device->elements[place].contact;
        add(sum, 1.0, device->elements[place].force);
        device->clamped |= contact->force != 0.0 && played[place].stiffness > 0.0
            && contact->force >= contact->level * played[place].force_level;
    }
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        if (!usable(sum[axis])) {
            return none(device, HAPTUNE_NOT_FINITE);
        }
    }
    device->clamped |= sqrt(product(sum, sum)) > peak_force;
    shortened(sum, peak_force);
    memcpy(device->force, sum, sizeof sum);
    memcpy(force, sum, sizeof sum);
    return device->status;
}
