"""The system of Song et al.: laser particle filters for separate people, on-line learned classifiers when they meet."""
