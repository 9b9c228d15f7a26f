"""Materials: the scattering of light by surfaces, one file a material."""
