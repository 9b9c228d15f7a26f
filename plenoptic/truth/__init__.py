"""Ground truth of raw pixels."""
