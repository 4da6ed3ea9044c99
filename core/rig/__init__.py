"""What an artist does next with a face: keys, a mesh with eyes and a mouth."""
