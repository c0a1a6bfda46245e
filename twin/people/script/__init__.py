"""Scripts of people: sequences of actions, or a recorded path."""
