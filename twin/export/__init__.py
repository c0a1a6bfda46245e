"""Recordings in other people's formats: MOTChallenge, KITTI, COCO, pictures, rerun, Foxglove."""
