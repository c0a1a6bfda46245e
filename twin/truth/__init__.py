"""The truth of a run: positions of people, their visibility, and situations of two people."""
