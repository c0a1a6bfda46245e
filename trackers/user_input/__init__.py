"""Input from users: text, plain data and arrays of bounded size, and former names of options."""
