"""Photos of one person in, a B-spline surface of the face out."""
