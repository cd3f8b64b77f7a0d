"""The page of a diagnosis, of any plant: its frame, its first screen, its words and its pictures."""
