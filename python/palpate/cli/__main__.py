"""``python -m palpate.cli``."""

import sys

from palpate.cli.app import main

sys.exit(main())
