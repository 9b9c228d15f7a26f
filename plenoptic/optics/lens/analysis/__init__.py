"""What exact and third-order rays say of a lens."""
