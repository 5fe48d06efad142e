"""followerd: makes a Pioneer robot follow one chosen person."""

__version__ = "0.1.0"
