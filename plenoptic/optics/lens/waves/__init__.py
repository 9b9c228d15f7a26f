"""Wave optics of lenses: wavefronts, Zernike fits, and point-spread functions with diffraction."""
