"""Tiles over threads, batch after batch, until there is enough."""
