"""Parts become one exposure: in memory, or row by row in a store."""
