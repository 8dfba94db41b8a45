"""Run the bench: `python -m benchmarks.methods.calibration`."""

import sys

from .bench import main

sys.exit(main())
