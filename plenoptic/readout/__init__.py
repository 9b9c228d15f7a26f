"""From an exposure to raw images: developing, reading, and the photon transfer curve."""
