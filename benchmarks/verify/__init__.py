"""Physics checks that ``mrwarp verify`` shows."""
