"""What the sensors on the walls would have reported: ideal readings, noise around them, and when they arrive."""
