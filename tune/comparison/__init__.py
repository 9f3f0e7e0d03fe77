"""Two devices or two profiles side by side, and whether the old profile holds on the new device."""
