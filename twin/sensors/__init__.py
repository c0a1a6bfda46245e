"""Sensors of the twin: ideal readings, layers of noise and faults around them, and the schedule of their arrival."""
