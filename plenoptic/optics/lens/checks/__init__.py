"""What looks wrong in a lens."""
