"""What a G-buffer producer, a tracer, an effect, a heuristic and a loader are. Nothing here knows a backend."""
