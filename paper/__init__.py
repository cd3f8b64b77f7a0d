"""The paper's laboratory: its tables and figures next to ours, the studies, and the claims. Not part of the wheel."""
