"""Legs in the scans of a low scanner: features of clusters, and a classifier that the twin taught."""
