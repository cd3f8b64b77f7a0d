"""USD assets: read, refuse, edit, record."""
