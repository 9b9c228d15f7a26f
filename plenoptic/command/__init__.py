"""The command `plenoptic`, also `python -m plenoptic`, for users without a program."""
