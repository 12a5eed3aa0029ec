"""How large a picture, and how long a sequence, may be."""

MAX_SIDE = 16384
"""Pixels."""

MAX_PIXELS = 8192 * 8192
"""A frame holds some 300 bytes a pixel: about 20 GB at this size."""

MOST_FRAMES = 1_000_000
"""Frames of one sequence."""
