${heading}
/*
 * CHAI3D's own velocity estimate is not the certified filter, and it has no virtual mass. Elements
 * with damping or mass are therefore played by the guard (haptune_guard.c) along the certified
 * axis, called once in each period of the haptic thread with the position of the device; their
 * materials are left without stiffness and viscosity so that nothing is felt twice.
 *
 * NOT certified: whatever CHAI3D computes itself. That is the stiffness of materials below, its
 * proxy, its haptic shading and friction, the other axes of the device, and a thread whose period
 * is not HAPTUNE_SAMPLE_TIME. A material's spring is the certified law only as long as the force is
 * its stiffness times the penetration along the axis, once a period, without delay besides, and no
 * more than its force level.
 */
#include "haptune_guard.h"

#if HAPTUNE_PROFILE != ${tag}
#error "haptune_guard.h comes from another profile than haptune_chai3d.hpp: export both again"
#endif
#ifndef HAPTUNE_CHAI3D_HPP
#define HAPTUNE_CHAI3D_HPP

#include <algorithm>
#include <cstdint>

#include "chai3d.h"

namespace haptune {
inline namespace profile_${word} { // so that a program of several profiles links each to its own

// Continuous and peak force (torque) of the actuator; compare what is sent with them.
const double continuous_force = ${continuous};
const double peak_force = ${peak};

// Stiffness and damping of the largest sum that is certified.
const double largest_stiffness = ${stiffness};
const double largest_damping = ${damping};

// Specifications of the device, none beyond what this profile allows: for every place where CHAI3D
// or an example of it asks them how much force, stiffness or damping there may be.
inline chai3d::cHapticDeviceInfo limited(chai3d::cHapticDeviceInfo info)
{
    info.${max_force} = std::min(info.${max_force}, peak_force);
    info.${max_stiffness} = std::min(info.${max_stiffness}, largest_stiffness);
    info.${max_damping} = std::min(info.${max_damping}, largest_damping);
    return info;
}

// Sets a material to one element. True where CHAI3D's spring is the whole element; false where the
// guard has to play it. A tool that maps the device to a larger world multiplies every way by
// workspace_scale, tool->getWorkspaceScaleFactor(), and forces not at all: the spring that a hand
// feels is the material's times this scale. Wrong scales, zero and below, leave the material limp.
inline bool set_material(
    const chai3d::cMaterialPtr& material, std::uint64_t element, double workspace_scale)
{
    material->setStiffness(0.0);
    material->setViscosity(0.0);
    material->setDamping(0.0);
    if (!(workspace_scale > 0.0)) {
        return false;
    }
    switch (element) {
${springs}    default:
        return false;
    }
}

// One axis of a device, played by the guard. Not for materials that set_material accepted.
class Axis
{
public:
    // direction: unit vector of the certified axis, positive as in the log it was identified from.
    explicit Axis(const chai3d::cVector3d& direction) : m_direction(direction)
    {
        haptune_init(&m_guard);
    }

    // Position along the axis, for force: of the device (getPosition), not of the tool, whose ways
    // are workspace_scale times as long; likewise rest in enter.
    double along(const chai3d::cVector3d& position) const
    {
        return m_direction.dot(position);
    }

    // Before elements give force: the face of walls along the axis, and to which side they push, 1
    // along the direction and -1 against it. Other springs rest where they are entered.
    haptune_status enter(std::uint64_t elements, double rest, int side)
    {
        return haptune_reset(&m_guard, elements, rest, side);
    }

    // ${what} of a certified set of elements. Every period, walls in it wherever the device is.
    chai3d::cVector3d force(
        std::uint64_t elements, std::uint32_t period, double position, double gain = 1.0)
    {
        return m_direction * haptune_force(&m_guard, elements, period, position, gain);
    }

    haptune_status status() const { return m_guard.status; }

private:
    chai3d::cVector3d m_direction;
    haptune_guard m_guard;
};
${of_axes}
} // namespace profile_${word}
} // namespace haptune

#endif
