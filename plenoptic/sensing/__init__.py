"""From light to numbers: what a sensor makes of an exposure, with its noise, filters, limits and faults."""
