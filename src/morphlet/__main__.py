"""The command line, as `python -m morphlet`."""

import sys

from morphlet.cli import main

sys.exit(main())
