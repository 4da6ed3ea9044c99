"""First floor: what the photos say."""
