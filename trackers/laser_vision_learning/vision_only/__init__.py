"""The paper's baseline by the camera alone: a particle filter a person, fed by a detector of people."""
