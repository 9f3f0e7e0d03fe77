
// All axes of a device, played by the guard. Not for materials that set_material accepted.
class Device
{
public:
    // directions: unit vectors of the certified axes, at right angles, as in the log: ${axes}.
    explicit Device(const chai3d::cVector3d (&directions)[HAPTUNE_AXES])
    {
        std::copy(directions, directions + HAPTUNE_AXES, m_directions);
        haptune_axes_init(&m_device);
    }

    // Before elements that are no walls give force.
    haptune_status enter(std::uint64_t elements) { return haptune_axes_enter(&m_device, elements); }

    // Where a face of a wall stands: free space is where the product of normal, a unit vector, and
    // the position of the device is offset or more.
    haptune_status place(
        unsigned face, std::uint64_t element, const chai3d::cVector3d& normal, double offset)
    {
        double parts[HAPTUNE_AXES];
        split(normal, parts);
        return haptune_axes_place(&m_device, face, element, parts, offset);
    }

    // ${what} of a certified set of elements that are no walls, and of a set of faces, 1 << place.
    // Every period, with the position of the device (getPosition), not of the tool.
    chai3d::cVector3d force(std::uint64_t elements, std::uint32_t faces, std::uint32_t period,
        const chai3d::cVector3d& position, double gain = 1.0)
    {
        double parts[HAPTUNE_AXES], forces[HAPTUNE_AXES];
        split(position, parts);
        haptune_axes_force(&m_device, elements, faces, period, parts, gain, forces);
        chai3d::cVector3d sum = m_directions[0] * forces[0];
        for (int axis = 1; axis < HAPTUNE_AXES; axis++) {
            sum = sum + m_directions[axis] * forces[axis];
        }
        return sum;
    }

    haptune_status status() const { return m_device.status; }

private:
    void split(const chai3d::cVector3d& vector, double (&parts)[HAPTUNE_AXES]) const
    {
        for (int axis = 0; axis < HAPTUNE_AXES; axis++) {
            parts[axis] = m_directions[axis].dot(vector);
        }
    }

    chai3d::cVector3d m_directions[HAPTUNE_AXES];
    haptune_axes m_device;
};
