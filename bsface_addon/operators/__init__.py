"""What the buttons do: each operator reads properties, calls core, writes objects."""
