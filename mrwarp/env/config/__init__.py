"""config of mrwarp.env; see the README's map."""
