"""People: bodies made of geoms, the gait that moves them, where they go, and how they keep clear of each other."""
