"""Design of a camera from targets."""
