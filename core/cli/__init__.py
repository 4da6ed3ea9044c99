"""Commands of ``python -m bsface`` besides the reconstruction itself."""
