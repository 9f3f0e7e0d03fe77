"""What a hand gets: rendered mass and damping, encoder ripple, vibration."""
