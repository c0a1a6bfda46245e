"""Body and head of every person from ceiling cameras and a pressure floor, after Mori, Matsumoto, Shimosaka, Noguchi and
Sato.
"""
