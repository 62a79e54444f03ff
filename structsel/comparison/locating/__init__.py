"""Where, when and how what a simulation leaves out acts."""
