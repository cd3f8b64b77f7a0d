"""What a user sees of the diagnosis of a robot log: page, pictures, and both robots side by side in rerun."""
