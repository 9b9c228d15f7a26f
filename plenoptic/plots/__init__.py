"""Figures of results. Matplotlib is imported on first use; without it they raise a PlenopticError, an ImportError too.

What is drawn is told by the attributes it has, since figures know no optics: another kind is an InvalidValueError.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
