"""Polygons of the floor plan, and the hulls of geoms."""
