"""kernels of mrwarp; see the README's map."""
