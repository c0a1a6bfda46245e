"""Puts the synthetic rooms of this folder on the path of the tests below it."""
