"""Motion of people over the floor: free floor, routes, social force, collision avoidance."""
