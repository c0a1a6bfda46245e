"""Detection of people in laser scans, before tracking: backgrounds, clusters, detections of one layer."""
