"""Reports on cameras: first-order properties, findings, drawings."""
