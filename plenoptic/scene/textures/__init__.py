"""Images laid over surfaces."""
