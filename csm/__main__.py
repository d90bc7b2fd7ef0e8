"""``python -m csm`` is ``csm``."""

import sys

from .cli import main

sys.exit(main())
