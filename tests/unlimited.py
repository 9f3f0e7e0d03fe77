"""An actuator and an encoder that bind nothing, stated as every fact of a device has to be."""

from identification import Device, ForceLimit, quantity

BOUNDLESS = ForceLimit(continuous=1e8, peak=1e9)
UNLIMITED = {"force_limit": BOUNDLESS, "encoder_resolution": quantity(1e-15)}


def stated(device: Device) -> Device:
    """The same device, linear, with bounds that bind nothing where it has none."""
    bounds = {name: each for name, each in UNLIMITED.items() if getattr(device, name) is None}
    return Device.model_validate({**dict(device), "missing": (), **bounds})
