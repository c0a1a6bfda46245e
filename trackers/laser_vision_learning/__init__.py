"""The system of Song et al.: laser particle filters while people are apart, classifiers that learn on-line when they meet."""
