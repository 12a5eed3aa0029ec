"""Mitsuba 3 for PHRT: a tracer (LLVM on the processor, OptiX on an NVIDIA GPU), and pictures by path tracing."""
