"""Triangle surfaces: their elements, what they must satisfy, how they are mended, and functions on them."""
