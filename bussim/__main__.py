"""``python -m bussim``: the command line."""

from bussim.cli import program

program()
