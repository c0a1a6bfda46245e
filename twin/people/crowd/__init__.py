"""Where people can go, and how they keep clear of each other."""
