"""Common to both plants: errors of simulation and instruments, sizes and intervals of effects, shapes of inputs."""
