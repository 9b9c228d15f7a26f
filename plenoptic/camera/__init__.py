"""Main lens, microlenses and sensor put together, placed in the world."""
