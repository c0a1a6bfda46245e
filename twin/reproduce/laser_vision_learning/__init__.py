"""`twin reproduce laser-vision-learning`: the paper's tables and figures beside ours."""
