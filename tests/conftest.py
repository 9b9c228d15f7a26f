"""What holds for all tests: examples that are drawn have as long as they take, since kernels compile on first use."""

from hypothesis import settings

settings.register_profile("plenoptic", settings(), deadline=None)
settings.load_profile("plenoptic")
