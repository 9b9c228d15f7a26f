"""Waves: wavefronts, Zernike fits, and images of points with diffraction."""
