"""The paper's tables and figures, ours beside theirs: one file per table or figure, a runner and a report."""
