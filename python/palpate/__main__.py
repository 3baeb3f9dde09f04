"""``python -m palpate``."""

import sys

from palpate.cli.app import main

sys.exit(main())
