"""The command line, as `python -m morphlet.cli`."""

import sys

from morphlet.cli import main

sys.exit(main())
