"""The digital twin of a room with people and sensors: observations, truth, and scores of any tracker."""
