"""The system of Bai and Takahashi: two-layer laser and fisheye camera, interacting multiple models."""
