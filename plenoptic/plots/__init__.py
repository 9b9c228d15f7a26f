"""Figures of results. Matplotlib is imported on first use; without it they raise a PlenopticError, an ImportError too.

Figures know no optics, and recognise their objects by attributes: another kind is an InvalidValueError.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
