"""Cases whose truth is computed by the proof's own plant: polynomial aircraft, and single-channel systems."""
