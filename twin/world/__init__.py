"""Construction of the world from a scenario, and its stepping."""
