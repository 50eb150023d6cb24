"""What belongs to the package and lies beside it in a clone (sitl/, config/default.yaml), and in it once it is installed."""

from pathlib import Path

PACKAGE = Path(__file__).parent


def outside(name: str) -> Path:
    """A file or folder by its path in a clone, wherever it lies."""
    inside = PACKAGE / name
    return inside if inside.exists() else PACKAGE.parent / name
