"""Point-spread functions by forward tracing."""
