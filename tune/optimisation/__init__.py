"""Device and scene to the largest perceivable effects: solvers propose, limits dispose."""
