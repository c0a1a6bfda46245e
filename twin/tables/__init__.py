"""Tables of text: dialects, columns, and the rows of people in them."""
