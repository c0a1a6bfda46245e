"""The world at one instant, for sensors and truth."""
