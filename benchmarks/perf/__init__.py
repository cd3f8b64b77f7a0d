"""What a step costs, part by part, and whether that got worse."""
