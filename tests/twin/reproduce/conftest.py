"""Shared by the tests of all reproductions: `results_file`."""
