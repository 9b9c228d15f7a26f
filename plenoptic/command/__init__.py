"""The command `plenoptic`, also `python -m plenoptic`: what users do without writing a program."""
