"""Entry point of ``python -m imapper_prob.cli``."""

from __future__ import annotations

import sys

from imapper_prob.cli import main

if __name__ == "__main__":
    sys.exit(main())
