"""Foot loads and steps of simulated people, compared with published data."""
