"""The conformance kit: one call puts a plugin through the contract of its kind.

    from phrt.testing import check_heuristic

    def test_it_keeps_the_contract():
        check_heuristic("nearest")

`check_heuristic`, `check_tracer`, `check_gbuffer`, `check_effect`, `check_loader` and `check_metric` take a plugin's name, its
descriptor, or its class, and options. They return None, or raise `BrokenContract` (an AssertionError) that names the rule and
the case. No pytest is needed; with hypothesis installed the cases of heuristics are searched by it and shrunk, else they are random
with a fixed seed.

`phrt.testing.candidates` and `phrt.testing.worlds` make candidates, worlds and views for tests of your own.
"""

from phrt.testing.contract import BrokenContract
from phrt.testing.effects import check_effect
from phrt.testing.gbuffers import check_gbuffer
from phrt.testing.heuristics import check_heuristic
from phrt.testing.loaders import check_loader
from phrt.testing.metrics import check_metric
from phrt.testing.tracers import check_tracer

__all__ = [
    "BrokenContract",
    "check_effect",
    "check_gbuffer",
    "check_heuristic",
    "check_loader",
    "check_metric",
    "check_tracer",
]
