"""How far from instability: gain, delay, phase, disk, damping, and passivity."""
