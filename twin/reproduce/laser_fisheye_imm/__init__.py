"""The figures of Bai and Takahashi, theirs beside ours, and further than the paper went."""
