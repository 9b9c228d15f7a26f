"""Analysis of lenses by exact and third-order rays."""
