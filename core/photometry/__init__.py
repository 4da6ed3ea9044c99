"""Photometry: intensities on the surface and how light explains them (section 2.2)."""
