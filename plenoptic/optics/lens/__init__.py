"""The main lens: a stack of surfaces and stops, ray tracing through it, and its analyses."""
