"""What a pressure floor says about people: from its 8-bit values to loads, and to clusters of them."""
