"""Planning of a calibration: which force to play on a device, within which limits."""
