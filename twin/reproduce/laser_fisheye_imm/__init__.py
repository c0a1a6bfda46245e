"""`twin reproduce laser-fisheye-imm`: figures and table of Bai and Takahashi, theirs beside ours, and further."""
