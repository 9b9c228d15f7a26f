"""Which stages run, and why."""
