"""Text tables: dialects, columns, and rows of people."""
