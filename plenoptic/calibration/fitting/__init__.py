"""Fit of camera, poses and board: projection, steps, errors, halves of the frames."""
