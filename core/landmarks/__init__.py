"""Landmarks: finding faces, 468 points on each, files, plausibility, selection."""
