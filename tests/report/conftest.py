import sys
from pathlib import Path

# The helpers that run campaigns.
sys.path.insert(0, str(Path(__file__).parents[1] / "farm"))
