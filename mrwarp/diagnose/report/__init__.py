"""Page and pictures of a diagnosis."""
