"""What part of the microlens plane feeds each pixel, and paths that start there."""
