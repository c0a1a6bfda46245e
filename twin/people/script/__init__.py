"""Scripts of people: actions one after another, or a recorded path."""
