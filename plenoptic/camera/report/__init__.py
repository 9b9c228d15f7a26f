"""What a camera is and does, in numbers."""
