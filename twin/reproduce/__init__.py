"""Reproductions of published tables and figures beside our results, for `twin reproduce`."""
