"""The paper's tables and figures, compared with ours: one file per table or figure, a runner and a report."""
