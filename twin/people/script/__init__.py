"""What people are told to do, one action after another, or by a recorded path."""
