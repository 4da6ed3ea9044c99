"""Ground floor: what a face is."""
