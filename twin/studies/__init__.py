"""Where sensors should go: placements searched for by coverage and by tracking, held-out figures, and a plan to build by."""
