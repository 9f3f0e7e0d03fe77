"""Is the loop stable, up to which gain, and how large may one effect be: exact, no iteration."""
