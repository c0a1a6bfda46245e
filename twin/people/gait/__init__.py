"""Walking and running: published gait data, footsteps, the pose of the body over them."""
