"""Pressure floor: from its 8-bit values to loads, and to clusters of them."""
