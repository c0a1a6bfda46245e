"""Classifiers that learn while they are used. They know no tracker and no sensor: samples, weights and labels alone."""
