"""Scene descriptions: text files with USD's concepts and names, read into a `phrt.scene.Scene`.

values (text to values with lines) -> layers (sublayers, references, overs, variants: one flat set of prims)
-> prims and validation (typed attributes) -> build (files read, everything placed).
"""

from phrt.description.document import schema
from phrt.description.overrides import parse_override

__all__ = ["parse_override", "schema"]
