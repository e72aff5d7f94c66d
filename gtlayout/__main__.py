"""``python -m gtlayout``: the command line, also where the command is not on the path."""

import sys

from gtlayout.cli.app import main

sys.exit(main())
