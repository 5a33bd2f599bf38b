"""``python -m bussim``: the command line."""

import sys

from bussim.cli import main

sys.exit(main())
