"""What the robot draws, how warm it gets and how far its battery reaches: plain models, without simulator or files."""
