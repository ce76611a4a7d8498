"""The scripts of docs/ import each other as scripts do, by their names."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "docs"))
