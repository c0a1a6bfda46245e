"""Tracks over time, independent of the measurement: synchronized frames, roster, track management, association, appearance."""
