"""The paper's baseline by camera: one particle filter per person, with a detector of people."""
