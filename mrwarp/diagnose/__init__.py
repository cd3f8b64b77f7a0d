"""What does the simulation get wrong, and why: ``mrwarp diagnose``."""
