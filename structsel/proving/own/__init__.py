"""Truth flights by our own plant: base models of the ready aircraft, and physics added that the simulation lacks."""
