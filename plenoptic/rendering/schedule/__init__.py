"""Tiles on threads or a cluster, batch after batch, until the budget is used."""
