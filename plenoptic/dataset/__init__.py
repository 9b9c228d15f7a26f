"""Data sets: the frames of sequences, with truth, errors and a manifest, in a folder that grows frame by frame."""

from plenoptic.dataset.contents import DataSet, read
from plenoptic.dataset.writing import write

__all__ = ["DataSet", "read", "write"]
