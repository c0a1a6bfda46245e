"""Find where sensors should go: search placements by coverage and tracking, validate the best, and plan the installation."""
