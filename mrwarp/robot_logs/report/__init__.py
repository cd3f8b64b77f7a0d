"""Report on the diagnosis of a robot log: page, pictures, and both robots side by side in rerun."""
