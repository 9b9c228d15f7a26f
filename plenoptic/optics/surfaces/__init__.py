"""Refracting surfaces."""
