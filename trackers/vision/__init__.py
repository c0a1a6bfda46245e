"""Vision: what pictures show of people before any tracking: foreground, windows, colours, outlines of heads, detections."""
