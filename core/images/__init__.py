"""Pictures: from files or arrays to upright RGB pixels with a place in the original."""
