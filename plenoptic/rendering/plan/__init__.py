"""Stages of a render, and the decisions on them."""
