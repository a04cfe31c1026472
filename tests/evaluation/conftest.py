"""Lets tests name the policies in own_policies.py as users name their own."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
