"""`twin reproduce laser-vision-learning`: tables and figures of Song et al., with our results."""
