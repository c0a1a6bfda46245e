"""One tracker on any subset of any rig: each sensor gives measurements with covariances, one state per person takes them."""
