"""Tables of rows of text: their dialects, their columns, and which columns say who is where."""
