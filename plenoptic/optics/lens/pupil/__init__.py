"""Pupils of a real lens: which rays pass the iris, aimed, bounded or sampled."""
