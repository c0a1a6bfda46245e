"""Polygons of the floor plan, and hulls of geoms."""
