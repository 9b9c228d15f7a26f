"""Display of figures and results in notebooks."""
