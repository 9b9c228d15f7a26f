"""Where things are and how they move: turns, poses, and rigid motions in time."""
