"""Where plugins' faults end: whoever fails is named, what is left of the frame goes on without it, and the run keeps the record.

fault.py      what is known of a fault, and the error that carries one
faults.py     the faults of a run: who is switched off, one warning each, or an error with `strict`
checks.py     what effects return
tracer.py     a tracer whose answers are checked batch by batch
gbuffer.py    a G-buffer producer whose pictures are checked
declared.py   what effects say of themselves, checked before the first frame
making.py     plugins made by name that are what their kind says
"""

from phrt.faults.fault import Fault, PluginFailure
from phrt.faults.faults import Faults

__all__ = ["Fault", "Faults", "PluginFailure"]
