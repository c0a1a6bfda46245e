"""What an image says about people before any tracking: torso windows and colour histograms."""
