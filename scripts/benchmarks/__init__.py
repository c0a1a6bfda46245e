"""Figures with targets, each measured by one function."""
