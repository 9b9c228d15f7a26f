"""What work runs on: the threads of this process, or the workers of a cluster."""
