
/* Of a sum of squares to 1, and of a product of normals to 0 or 1. */
#define ROUNDING 1e-9

static double product(const double one[HAPTUNE_AXES], const double other[HAPTUNE_AXES])
{
    double sum = 0.0;
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        sum += one[axis] * other[axis];
    }
    return sum;
}

/* Shortens a vector to a length, and gives the length it has then. */
static double shortened(double vector[HAPTUNE_AXES], double most)
{
    const double length = sqrt(product(vector, vector));
    unsigned axis;
    if (!(length > most)) {
        return length;
    }
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        vector[axis] *= most / length;
    }
    return most;
}

/* Position, velocity and acceleration along a normal. */
static haptune_estimate along(
    const haptune_estimate axes[HAPTUNE_AXES], const double normal[HAPTUNE_AXES])
{
    haptune_estimate found;
    unsigned axis;
    memset(&found, 0, sizeof found);
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        found.last += normal[axis] * axes[axis].last;
        found.velocity += normal[axis] * axes[axis].velocity;
        found.acceleration += normal[axis] * axes[axis].acceleration;
    }
    return found;
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

/* Whether faces and elements may act at once. */
static haptune_status fitting(const haptune_axes *device, uint64_t elements, uint32_t faces)
{
    unsigned one, other;
    if (!certified(elements)) {
        return HAPTUNE_NOT_TOGETHER;
    }
    for (one = 0; one < HAPTUNE_FACES; one++) {
        const haptune_face *here = &device->faces[one];
        uint64_t ahead = elements | bit(here->element);
        if (!(faces >> one & 1u)) {
            continue;
        }
        for (other = 0; other < HAPTUNE_FACES; other++) {
            const haptune_face *there = &device->faces[other];
            const double turned = product(here->normal, there->normal);
            if (other == one || !(faces >> other & 1u)) {
                continue;
            }
            if (fabs(turned) <= ROUNDING || turned >= 1.0 - ROUNDING) {
                if ((turned > 0.5) == (here->element == there->element)) {
                    return HAPTUNE_NOT_TOGETHER; /* two laws at right angles, one law twice */
                }
                ahead |= turned > 0.5 ? bit(there->element) : 0;
            } else if (turned > ROUNDING - 1.0) {
                return HAPTUNE_NOT_SQUARE;
            } else if (narrow(&played[here->element], &played[there->element],
                           -there->contact.face - here->contact.face)) {
                return HAPTUNE_TOO_NARROW;
            }
        }
        if (!certified(ahead)) {
            return HAPTUNE_NOT_TOGETHER;
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
        haptune_contact *contact = &device->faces[place].contact;
        contact->wanted = 0;
        contact->level = contact->force = 0.0;
    }
    memset(device->force, 0, sizeof device->force);
    device->status = reason;
    return reason;
}

/* As act, of an element that is the same in every direction. */
static void act_all(const effects *effect, haptune_element *element,
    const haptune_estimate axes[HAPTUNE_AXES], double asked, double change)
{
    haptune_contact *contact = &element->contact;
    const int spring = effect->stiffness > 0.0;
    const int enters = asked > 0.0 && !contact->wanted && contact->level == 0.0;
    double u[HAPTUNE_AXES], length;
    unsigned axis;
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        if (enters && spring) {
            element->rest[axis] = axes[axis].last;
            contact->quiet = 0;
        }
        u[axis] = (effect->stiffness * (axes[axis].last - element->rest[axis])
            + effect->damping * axes[axis].velocity) + effect->mass * axes[axis].acceleration;
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

/* One part of a call: what is switched, then what fades. */
static int act_those(haptune_axes *device, uint64_t elements, uint32_t faces, double gain,
    uint32_t steps, int fades, int pushing)
{
    unsigned place;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        haptune_face *face = &device->faces[place];
        const effects *effect = &played[face->element];
        if (face->contact.entered && (effect->fade < 1.0) == fades) {
            const haptune_estimate axis = along(device->axes, face->normal);
            act(effect, &face->contact, &axis, (faces >> place & 1u) ? gain : 0.0,
                pushing ? 0.0 : effect->fade * steps);
            pushing |= face->contact.force != 0.0;
        }
    }
    for (place = 0; place < COUNT; place++) {
        if (!(walls & bit(place)) && (played[place].fade < 1.0) == fades) {
            act_all(&played[place], &device->elements[place], device->axes,
                (elements & bit(place)) ? gain : 0.0, pushing ? 0.0 : played[place].fade * steps);
        }
    }
    return pushing;
}

static int at_limit(const effects *effect, const haptune_contact *contact)
{
    return contact->force != 0.0 && effect->stiffness > 0.0
        && fabs(contact->force) >= contact->level * effect->force_level;
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
    if (here->contact.force != 0.0) {
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
    here->contact.entered = here->contact.side = 1;
    here->contact.face = offset;
    for (place = 0; place < HAPTUNE_FACES; place++) {
        wanted |= device->faces[place].contact.wanted ? UINT32_C(1) << place : 0;
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
    uint32_t closing = 0;
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
        acting |= contact->level > 0.0 ? bit(place) : 0;
        fading |= contact->level > 0.0 && played[place].fade < 1.0 ? bit(place) : 0;
    }
    for (place = 0; place < 32; place++) {
        if ((faces >> place & 1u)
            && (place >= HAPTUNE_FACES || !device->faces[place].contact.entered)) {
            return none(device, HAPTUNE_NOT_ENTERED);
        }
        if (place < HAPTUNE_FACES && device->faces[place].contact.level > 0.0
            && played[device->faces[place].element].fade < 1.0) {
            closing |= UINT32_C(1) << place;
        }
    }
    if (!usable(gain) || gain < 0.0 || gain > 1.0) {
        return none(device, HAPTUNE_BAD_GAIN);
    }
    device->status = fitting(device, elements, faces);
    if (device->status != HAPTUNE_OK) {
        return none(device, device->status);
    }
    if (fitting(device, elements | fading, faces | closing) != HAPTUNE_OK) {
        elements &= acting;
        if (fitting(device, elements | fading, faces | closing) != HAPTUNE_OK) {
            return none(device, HAPTUNE_NOT_TOGETHER);
        }
        device->status = HAPTUNE_WAITING;
    }
    act_those(device, elements, faces, gain, steps, 1,
        act_those(device, elements, faces, gain, steps, 0, 0));
    for (axis = 0; axis < HAPTUNE_AXES; axis++) {
        for (place = 0; place < COUNT; place++) {
            sum[axis] += device->elements[place].force[axis];
        }
        for (place = 0; place < HAPTUNE_FACES; place++) {
            sum[axis] += device->faces[place].contact.force * device->faces[place].normal[axis];
        }
    }
    for (place = 0; place < COUNT; place++) {
        device->clamped |= at_limit(&played[place], &device->elements[place].contact);
    }
    for (place = 0; place < HAPTUNE_FACES; place++) {
        device->clamped |= at_limit(
            &played[device->faces[place].element], &device->faces[place].contact);
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
