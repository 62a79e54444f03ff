"""Kernels: arrays in, arrays out. Imports numpy, scipy, numba and structsel.errors only."""
