"""The texture: what the photos say about the colour of the skin."""
