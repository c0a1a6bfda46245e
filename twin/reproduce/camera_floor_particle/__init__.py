"""`twin reproduce camera-floor-particle`: the experiments of Mori and others, with our results."""
