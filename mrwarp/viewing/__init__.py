"""viewing of mrwarp: what is shown of a robot, in rerun and in pictures; see the README's map."""
