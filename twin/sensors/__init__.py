"""Sensors: ideal readings, layers of noise and faults, and the schedule of arrivals."""
