"""Vision before tracking: foreground, windows, colours, outlines of heads, detections."""
