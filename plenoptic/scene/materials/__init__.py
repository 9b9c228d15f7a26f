"""What surfaces do with light: one file a material."""
