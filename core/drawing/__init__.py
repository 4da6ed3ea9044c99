"""Pictures of faces and of numbers: renderer, colour maps, plots."""
