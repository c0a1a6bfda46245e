"""Bags: files on disk, read message by message within bounds, and what is damaged in them."""
