"""Runs the command line: python3 -m selenograph."""

import sys

from .command_line import main

if __name__ == "__main__":
    sys.exit(main())
