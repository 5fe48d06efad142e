"""Files that ship with the program: `config/` of the checkout, or its copy in the package."""

from pathlib import Path

PACKAGE = Path(__file__).parent
CONFIG = PACKAGE.parent / "config"
INSTALLED = PACKAGE / "share" / "config"


def shipped(*parts: str) -> Path:
    """The path of a file or folder under `config/`."""
    return (INSTALLED if INSTALLED.is_dir() else CONFIG).joinpath(*parts)
