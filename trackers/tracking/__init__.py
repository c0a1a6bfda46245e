"""Targets over time, whatever they are measured by: synchronized frames, roster, track management, association, appearance."""
