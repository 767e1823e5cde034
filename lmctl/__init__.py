"""lmctl: from a part and its materials to a finished laser-cladding build."""

__version__ = "0.1.0"

__all__ = ["__version__"]
