"""The command `plenoptic`, where it is not on the path: ``python -m plenoptic``."""

import sys

from plenoptic.command.main import main

if __name__ == "__main__":
    sys.exit(main())
