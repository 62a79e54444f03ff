"""What both plants share: errors of simulation and instruments, sizes and intervals of effects, shapes of inputs."""
