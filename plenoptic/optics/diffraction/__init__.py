"""What openings do to light because it is a wave."""
