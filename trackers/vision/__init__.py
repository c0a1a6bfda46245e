"""What an image says about people before any tracking: foreground masks, torso windows and colour histograms."""
