
/*
 * All axes of the device in one state: ${axes}. Positions and forces are vectors in one frame with
 * right angles, the device's or any that is turned against it: elements are the same in every
 * direction, and a force that is cut keeps its own. Link with the mathematical library (-lm): sqrt.
 *
 * A face is a plane at which a wall pushes one way, with a normal of its own. All faces of a wall
 * that are given at once leave one convex room, whatever its angles: the wall pushes back to the
 * nearest place in it. Faces of several walls are parallel: what is certified. Corners that stick
 * out are faces given in turn; each moves while it gives no force.
 *
 *   haptune_axes_init(&device);
 *   haptune_axes_enter(&device, FLUID);                      once for each element that is no wall
 *   haptune_axes_place(&device, 0, WALL, normal, offset);    a face, in place 0
 *   haptune_axes_force(&device, wet ? FLUID : 0, 1u << 0, period, position, 1.0, force);
 */
#define HAPTUNE_AXES ${axis_count}
#define HAPTUNE_FACES 16 /* that one state holds; sets of them are joined by |, 1 << place */
#define haptune_axes_init haptune_axes_init_${word}
#define haptune_axes_enter haptune_axes_enter_${word}
#define haptune_axes_place haptune_axes_place_${word}
#define haptune_axes_force haptune_axes_force_${word}

typedef struct {
    haptune_contact contact; /* its force is the length of the vector */
    double rest[HAPTUNE_AXES];
    double force[HAPTUNE_AXES];
} haptune_element;

typedef struct {
    unsigned element;            /* place of its effects */
    double normal[HAPTUNE_AXES]; /* of length 1, towards where it pushes */
    double offset, rest;         /* where it is to stand, and where it does */
    int entered, acting, pushing;
    uint32_t clear; /* samples in a row without force where it is to stand */
} haptune_face;

/* One for each device and loop; written by the functions below alone. */
typedef struct {
    haptune_status status; /* of the last call */
    int clamped;           /* 1 where a spring, or the last force, was cut at its limit */
    uint32_t missed, glitches, waiting; /* as of a haptune_guard */
    double force[HAPTUNE_AXES];
    haptune_estimate axes[HAPTUNE_AXES];
    haptune_element elements[${count}];
    haptune_face faces[HAPTUNE_FACES];
} haptune_axes;

/* Before anything else: nothing was read, no element is entered, no face has a place. As
 * of a haptune_guard the first reading is taken for one of a device at rest. */
HAPTUNE_API void haptune_axes_init(haptune_axes *device);

/* Before elements that are no walls give their first force; springs rest where they are wanted. */
HAPTUNE_API haptune_status haptune_axes_enter(haptune_axes *device, uint64_t elements);

/*
 * Where a face stands: free space is where the product of normal and position is offset (${length})
 * or more. element is one wall. HAPTUNE_PUSHING, HAPTUNE_TOO_NARROW (no room is left) and
 * HAPTUNE_NOT_TOGETHER leave all as it was; after HAPTUNE_NO_SIDE (the length of the normal is not
 * 1) and HAPTUNE_NOT_FINITE the face has no place.
 */
HAPTUNE_API haptune_status haptune_axes_place(haptune_axes *device, unsigned face, uint64_t element,
    const double normal[HAPTUNE_AXES], double offset);

/*
 * The force (${force}) of a set of elements that are no walls, and of a set of faces. Every period,
 * as haptune_force: a face stays in its set wherever the device is, unless its wall ends beside it.
 */
HAPTUNE_API haptune_status haptune_axes_force(haptune_axes *device, uint64_t elements,
    uint32_t faces, uint32_t period, const double position[HAPTUNE_AXES], double gain,
    double force[HAPTUNE_AXES]);
