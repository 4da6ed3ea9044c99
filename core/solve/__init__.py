"""Second floor: making the face."""
