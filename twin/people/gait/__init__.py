"""How people walk and run: published gait data, footsteps, the pose of the body over them."""
