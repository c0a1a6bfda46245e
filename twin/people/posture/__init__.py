"""Postures beside walking: sitting, lying, bending, reaching, looking."""
