"""The world at one instant, as sensors and truth look at it."""
