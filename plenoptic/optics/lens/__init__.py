"""The main lens: a stack of surfaces and stops, and how rays go through it."""
