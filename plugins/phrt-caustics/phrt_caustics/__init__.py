"""phrt-caustics: light that glass and mirrors gather on what is behind or beside them, as an effect of PHRT."""

__version__ = "0.1.0"
