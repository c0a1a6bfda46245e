"""`twin reproduce laser-fisheye-imm`: figures and table of Bai and Takahashi, with our results, and further conditions."""
