"""Third floor: what leaves."""
