"""The device: mass, damping, hardware, intervals, and the box of all of them."""
