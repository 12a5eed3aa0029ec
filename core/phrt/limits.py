"""How large a picture, and how long a sequence, may be."""

MAX_SIDE = 16384
"""Pixels."""

MAX_PIXELS = 8192 * 8192
"""The G-buffer alone holds 104 bytes a pixel, 7 GB at this size; layers and direct light come on top, by the light."""

MOST_FRAMES = 1_000_000
"""Frames of one sequence."""
