"""Building the world from a scenario, and stepping it."""
