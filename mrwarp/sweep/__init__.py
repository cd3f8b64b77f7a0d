"""sweep of mrwarp; see the README's map."""
