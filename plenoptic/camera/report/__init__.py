"""Report on a camera in numbers."""
