"""Lenses: what they are made of, how they are described, and how light goes through them."""
