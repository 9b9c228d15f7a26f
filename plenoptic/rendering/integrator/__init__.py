"""Light transport: tracing of paths through the scene."""
