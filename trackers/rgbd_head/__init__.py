"""Head position and direction in 3-D from stereo RGB-D cameras and a model of the room, after Suzuki et al. (2007)."""
