"""Random scenes: rooms, people and sensor rigs from distributions and a seed, as plain MJCF and YAML."""
