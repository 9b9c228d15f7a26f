"""How figures and results show in notebooks."""
