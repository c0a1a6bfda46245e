"""What only the twin knows: where people are, what of them is seen, and what passes between them."""
