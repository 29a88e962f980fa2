"""Field and structure together: equilibria, damping ratios, responses."""
