"""`twin reproduce rgbd-head`: the experiments of Suzuki and others, with our results."""
