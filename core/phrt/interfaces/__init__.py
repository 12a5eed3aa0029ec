"""What a G-buffer producer, a tracer, an effect, a heuristic, a loader and a metric are. Nothing here knows a backend."""
