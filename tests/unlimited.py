"""An actuator and an encoder that bind nothing, stated as every fact of a device has to be."""

from identification import ForceLimit, quantity

BOUNDLESS = ForceLimit(continuous=1e8, peak=1e9)
UNLIMITED = {"force_limit": BOUNDLESS, "encoder_resolution": quantity(1e-15)}
