"""A scan of the empty room, and the model that trackers get of it."""
