"""Recordings in other formats: MOTChallenge, KITTI, COCO, pictures, rerun, Foxglove."""
