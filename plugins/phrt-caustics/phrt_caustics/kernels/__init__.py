"""What is done photon by photon and pixel by pixel, compiled: pure functions over arrays."""
