"""Body and head of every person by ceiling cameras and a pressure floor, after Mori, Matsumoto, Shimosaka, Noguchi and Sato."""
