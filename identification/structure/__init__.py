"""Which terms a log asks for beyond mass and damping."""
