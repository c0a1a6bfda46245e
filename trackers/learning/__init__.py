"""On-line classifiers, independent of trackers and sensors: samples, weights and labels."""
