"""Bodies made of geoms: proportions, skeleton, clothes, faces."""
