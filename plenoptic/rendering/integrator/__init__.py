"""Light transport: paths through the scene."""
