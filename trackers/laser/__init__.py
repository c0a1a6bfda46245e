"""What a laser scan says about people before any tracking: backgrounds, clusters, detections of one layer."""
