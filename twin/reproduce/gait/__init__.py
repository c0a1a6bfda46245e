"""How people load the floor and step, beside published data."""
