"""Simulated people: bodies made of geoms, gait, motion over the floor, postures and scripts."""
