"""Recordings: bags in and out, tables, video."""
