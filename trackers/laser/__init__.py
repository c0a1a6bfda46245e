"""People in laser scans before any tracking: backgrounds, clusters, detections of one layer."""
