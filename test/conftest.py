"""The benchmarks are not installed: tests find them here, after everything that is."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
