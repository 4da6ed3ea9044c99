"""Cameras: projection, linear pose (section 2.3.1), which views are missing."""
