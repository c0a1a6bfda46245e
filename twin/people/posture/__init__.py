"""What bodies do beside walking: sitting, lying, bending, reaching, looking."""
