"""Light that surfaces reflect, transmit and absorb: bare glass and thin films."""
