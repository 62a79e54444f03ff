"""Cases whose truth is computed by JSBSim: a foreign plant, with effects of its own."""
